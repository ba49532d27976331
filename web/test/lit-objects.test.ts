/** What is added to a scene is lit by the probes of the file, with either renderer, while its walls keep their field. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { LearnedScene, LightwellLoaderPlugin, parseLearned } from "lightwell";
import { LearnedNodeScene } from "lightwell/webgpu";
import { Matrix4, Mesh, MeshStandardMaterial, PerspectiveCamera, Vector3 } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { describe, expect, it } from "vitest";
import { readContainer } from "../runtime/src/container.ts";
import { readExtension } from "../runtime/src/extension.ts";
import { evaluate } from "../runtime/src/graph/evaluate.ts";
import type { Answer, Request } from "./pages/renderers.ts";
import { CAMERA, LAMP, linearField, linearRadiance, plainRoom, stillField, STILL, WHITE } from "./support/fixtures.ts";
import { type Fixture, type FixtureField, writeGlb } from "./support/glb.ts";
import { backWallPoint } from "./support/optics.ts";
import { openModule } from "./support/module-page.ts";

type Point = [number, number, number];

/**
 * `lightwell bake doorway --field factored+probes --vary "node:Door.rotation=y:0..90" --spacing 2m --quality draft`, with few paths: the
 * door is shut at 0, and the room beyond it has no lamp.
 */
const BAKED = readFileSync(fileURLToPath(new URL("fixtures/field-and-probes.glb", import.meta.url)));
const [WIDTH, HEIGHT, RADIUS] = [96, 72, 0.25];
/** Of a white surface that is no metal. */
const REFLECTANCE = 1.04;

/** Radiance = 0.1 + 0.05 n + 0.02 x. */
const AIR: FixtureField = {
  name: "lamps",
  role: "static",
  graph: {
    version: 1,
    inputs: { position: 3, normal: 3 },
    nodes: [
      { id: "n", op: "affine", inputs: ["normal"], scale: [0.05, 0.05, 0.05], offset: [0.1, 0.1, 0.1] },
      { id: "x", op: "affine", inputs: ["position"], scale: [0.02, 0.02, 0.02], offset: [0, 0, 0] },
      { id: "y", op: "add", inputs: ["n", "x"] },
    ],
    outputs: { radiance: "y" },
  },
};

/** Radiance = (0.3 + 0.1 light) (0.5 + pose): of a light beside what moves. */
const BESIDE_A_MOVER: FixtureField = {
  name: "both",
  role: "indirect",
  variable: 0,
  graph: {
    version: 1,
    inputs: { position: 3, normal: 3, light: 3, pose: 1 },
    nodes: [
      { id: "l", op: "affine", inputs: ["light"], scale: [0.1, 0.1, 0.1], offset: [0.3, 0.3, 0.3], per_frame: true },
      { id: "p", op: "affine", inputs: ["pose"], scale: [1], offset: [0.5], per_frame: true },
      { id: "factor", op: "multiply", inputs: ["l", "p"], per_frame: true },
      { id: "one", op: "affine", inputs: ["position"], scale: [0, 0, 0], offset: [1, 1, 1] },
      { id: "y", op: "multiply", inputs: ["one", "factor"] },
    ],
    outputs: { radiance: "y" },
  },
};
const SLIDE = { name: "Slide", kind: "node", node: 1, path: "translation", axis: [0, 1, 0], range: [0, 0.1], unit: "metres", initial: 0 };

/** Point and normal of the ball in a pixel. */
function onBall(x: number, y: number, { position, target, fovY }: Request["camera"], center: Point): { point: Point; normal: Point } {
  const camera = new PerspectiveCamera(fovY, WIDTH / HEIGHT, 0.01, 100);
  camera.position.set(...position);
  camera.lookAt(...target);
  camera.updateMatrixWorld();
  const toWorld = new Matrix4().multiplyMatrices(camera.matrixWorld, camera.projectionMatrixInverse);
  const ray = new Vector3((2 * (x + 0.5)) / WIDTH - 1, 1 - (2 * (y + 0.5)) / HEIGHT, 0.5).applyMatrix4(toWorld).sub(camera.position).normalize();
  const from = camera.position.clone().sub(new Vector3(...center));
  const along = from.dot(ray);
  const point = camera.position.clone().addScaledVector(ray, -along - Math.sqrt(along ** 2 - from.lengthSq() + RADIUS ** 2));
  const normal = point.clone().sub(new Vector3(...center)).divideScalar(RADIUS);
  return { point: point.toArray(), normal: normal.toArray() };
}

const eye = (place: Point): Request["camera"] => ({ position: [place[0], place[1], place[2] + 1], target: place, fovY: 40 });

const opened = openModule("renderers.ts", "ready");

const draw = (kind: Request["kind"], glb: Uint8Array, change: Partial<Request>): Promise<Answer> =>
  opened.page.evaluate((request) => window.draw(request), {
    glb: Buffer.from(glb).toString("base64"),
    kind,
    width: WIDTH,
    height: HEIGHT,
    camera: { position: CAMERA.position, target: CAMERA.target, fovY: CAMERA.fov_y } as Request["camera"],
    ...change,
  });
const room = (change: Partial<Fixture> = {}) => writeGlb(plainRoom(change));
const pixel = ({ data }: Answer, x: number, y: number) => data.slice(4 * (y * WIDTH + x), 4 * (y * WIDTH + x) + 3);

describe.each((process.env.LIGHTWELL_LONG_TESTS ? ["webgl", "webgpu"] : ["webgpu"]) as ("webgl" | "webgpu")[])("with %s", (kind) => {
  it("a white ball shows reflectance · probes, the wall behind it its field", async () => {
    const lit: Point = [0, 1, 0.5];
    const camera = { position: CAMERA.position, target: CAMERA.target, fovY: CAMERA.fov_y } as Request["camera"];
    const indirect = { ...linearField(), name: "air" };
    const answer = await draw(kind, room({ fields: [linearField(), stillField()], probes: [AIR, indirect] }), { lit });
    for (const [x, y] of [[48, 36], [46, 33], [51, 38]] as const) {
      const { point, normal } = onBall(x, y, camera, lit);
      const moving = linearRadiance(point, LAMP.initial);
      pixel(answer, x, y).forEach((value, c) => {
        const air = 0.1 + 0.05 * normal[c]! + 0.02 * point[c]!;
        expect(Math.abs(value / (REFLECTANCE * (air + moving[c]! * LAMP.color[c]! * LAMP.intensity)) - 1)).toBeLessThan(5e-3);
      });
    }
    const wall = linearRadiance(backWallPoint(38, 30, WIDTH, HEIGHT, -1), LAMP.initial);
    pixel(answer, 38, 30).forEach((value, c) => {
      const expected = (WHITE[0] + 0.04) * (wall[c]! * LAMP.color[c]! * LAMP.intensity + STILL[c]!);
      expect(Math.abs(value / expected - 1)).toBeLessThan(2e-3);
    });
  });

  it("its light follows a lamp and what moves together", async () => {
    const lit: Point = [0, 1, 0.5];
    const glb = room({ variables: [LAMP, SLIDE], fields: [linearField()], probes: [BESIDE_A_MOVER] });
    for (const slid of [0, 0.07]) {
      const answer = await draw(kind, glb, { lit, movers: { Slide: slid } });
      pixel(answer, 48, 36).forEach((value, c) => {
        const expected = (0.3 + 0.1 * LAMP.initial[c]!) * (0.5 + slid / 0.1) * LAMP.color[c]! * LAMP.intensity;
        expect(Math.abs(value / (REFLECTANCE * expected) - 1)).toBeLessThan(5e-3);
      });
    }
  });

  it("in a baked file it is lit as the probes' graph says, and follows the door", async () => {
    const { json, binary } = readContainer(new Uint8Array(BAKED));
    const views = json.bufferViews as { byteOffset?: number; byteLength: number }[];
    const bufferView = async (i: number) => binary!.slice(views[i]!.byteOffset ?? 0, (views[i]!.byteOffset ?? 0) + views[i]!.byteLength).buffer as ArrayBuffer;
    const texture = async () => ({ source: null, width: 1, height: 1 });
    const { graph } = (await readExtension(json, { bufferView, texture }))!.probes[0]!;
    const seen: Record<string, number> = {};
    for (const [name, lit, degrees] of [["lamp", [-1.5, 1.2, 0], 90], ["shut", [1.5, 1.2, 0], 0], ["open", [1.5, 1.2, 0], 90]] as [string, Point, number][]) {
      const camera = eye(lit);
      const answer = await draw(kind, BAKED, { lit, camera, movers: { Door: degrees } });
      for (const [x, y] of [[48, 36], [42, 30]] as const) {
        const { point, normal } = onBall(x, y, camera, lit);
        const expected = evaluate(graph, { position: point, normal, pose: [degrees / 90] }).radiance!;
        pixel(answer, x, y).forEach((value, c) => expect(Math.abs(value - REFLECTANCE * Math.max(expected[c]!, 0))).toBeLessThan(2e-3 + 0.02 * expected[c]!));
      }
      seen[name] = pixel(answer, 48, 36)[0]!;
    }
    expect(seen.lamp).toBeGreaterThan(0.1);
    expect(seen.open).toBeGreaterThan(1e-3);
    expect(seen.shut).toBeLessThan(0.1 * seen.open!);
  });
});

it.each([["WebGLRenderer", LearnedScene], ["WebGPURenderer", LearnedNodeScene]] as const)("objects of one material are lit until the last is removed: %s", async (_name, Scene) => {
  const loader = new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser));
  const learned = new Scene(await parseLearned(loader, room({ fields: [stillField()], probes: [AIR] }).buffer));
  const material = new MeshStandardMaterial();
  const isLit = () => Object.hasOwn(material, "customProgramCacheKey");
  const objects = [new Mesh(undefined, material), new Mesh(undefined, material)];
  for (const object of objects) await learned.addLit(object);
  expect(learned.removeLit(objects[0]!)).toBe(true);
  expect(isLit()).toBe(true);
  expect(learned.removeLit(objects[1]!)).toBe(true);
  expect(isLit()).toBe(false);
});

it("a file without probes, and an object under the root, are refused", async () => {
  const lit: Point = [0, 1, 0.5];
  await expect(draw("webgl", room(), { lit })).rejects.toThrow("expected a file with probes, found none; bake it with --field factored+probes");
  const glb = room({ fields: [stillField()], probes: [AIR] });
  await expect(draw("webgl", glb, { lit, litUnder: true })).rejects.toThrow("expected an object beside root, found one under it");
});
