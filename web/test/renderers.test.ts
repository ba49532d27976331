/** Both renderers of three.js show the same learned light, the closed form's, and nothing is left when it is disposed of. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, describe, expect, it } from "vitest";
import type { Answer, Request } from "./pages/renderers.ts";
import { type Backend, launch, openPage, Site } from "./support/browser.ts";
import { bundle, modulePage } from "./support/bundle.ts";
import { expertField } from "./support/experts.ts";
import { CAMERA, LAMP, linearField, linearRadiance, plainRoom, stillField, STILL, WHITE } from "./support/fixtures.ts";
import { ball, type Fixture, matte, quad, writeGlb } from "./support/glb.ts";
import { backWallPoint } from "./support/optics.ts";

const [WIDTH, HEIGHT] = [96, 72];
const REFLECTANCE = WHITE[0] + 0.04;
const EYE = { position: CAMERA.position, target: CAMERA.target, fovY: CAMERA.fov_y } as Request["camera"];
const LIGHTMAP = readFileSync(fileURLToPath(new URL("fixtures/lightmap.glb", import.meta.url)));

const base64 = (bytes: Uint8Array) => Buffer.from(bytes).toString("base64");

let code = "";
beforeAll(async () => {
  code = await bundle("pages/renderers.ts");
});

/** A normal map of one colour, 192 166 231, and the normal that it says where u runs along +x and v along −y. */
const NORMAL_MAP = "iVBORw0KGgoAAAANSUhEUgAAAAIAAAACCAIAAAD91JpzAAAAFklEQVR4nGM8sOw5AwMDEwMDAwMDAwAbnwJRWH6eywAAAABJRU5ErkJggg==";
const BENT = [0.5044, 0.3011, 0.8093] as const;

/** The back wall with a normal map, facing the eye or away from it, and a field that shows its shading normal. */
function relief(back: boolean): Uint8Array {
  const wall = back ? quad(0, [1, 0, -1], [-2, 0, 0], [0, 2, 0]) : quad(0, [-1, 0, -1], [2, 0, 0], [0, 2, 0]);
  wall.uv = back ? [1, 1, 0, 1, 0, 0, 1, 0] : [0, 1, 1, 1, 1, 0, 0, 0];
  const material = { ...matte(...WHITE), normalTexture: { index: 0 }, doubleSided: true };
  const graph = {
    version: 1,
    inputs: { shading_normal: 3 },
    nodes: [{ id: "y", op: "affine", inputs: ["shading_normal"], scale: [0.4, 0.4, 0.4], offset: [0.5, 0.5, 0.5] }],
    outputs: { radiance: "y" },
  };
  return writeGlb({
    meshes: [wall],
    materials: [material],
    variables: [],
    fields: [{ name: "normals", role: "static", graph }],
    tamper: (json) => {
      const document = json as Record<string, unknown>;
      Object.assign(document, { images: [{ uri: `data:image/png;base64,${NORMAL_MAP}` }], textures: [{ source: 0 }] });
    },
  });
}

/** Nodes that move came with the second version of the format. */
const asVersion2: Fixture["tamper"] = (json) => void Object.assign((json.extensions as unknown as Record<string, object>).LIGHTWELL_neural_radiance!, { version: 2 });

/** What each launch can run; the tests of the page run on llvmpipe too. */
const CASES: [Backend, Request["kind"]][] = [
  ["swiftshader", "webgl"],
  ["swiftshader", "webgpu"],
  ["swiftshader", "fallback"],
  ...(process.env.LIGHTWELL_LONG_TESTS ? [["llvmpipe", "webgl"] as [Backend, Request["kind"]]] : []),
];

describe.each([...new Set(CASES.map(([backend]) => backend))])("on %s", (backend) => {
  let browser: Browser;
  let page: Page;
  let errors: string[];
  const site = new Site();

  beforeAll(async () => {
    await site.open();
    browser = await launch(backend);
    ({ page, errors } = await openPage(browser));
    await page.goto(site.put("/index.html", modulePage(code)));
    await page.waitForFunction(() => window.ready);
  }, 90_000);

  afterAll(async () => {
    await browser?.close();
    await site.close();
    expect(errors).toEqual([]);
  });

  const draw = (kind: Request["kind"], glb: Uint8Array, change: Partial<Request> = {}): Promise<Answer> =>
    page.evaluate((request) => window.draw(request), {
      glb: base64(glb),
      kind,
      width: WIDTH,
      height: HEIGHT,
      camera: EYE,
      ...change,
    });
  const room = (change: Partial<Fixture> = {}) => writeGlb(plainRoom(change));
  const kinds = CASES.filter(([name]) => name === backend).map(([, kind]) => kind);
  // What does not depend on the text of a field runs once with each adapter.
  const adapters = process.env.LIGHTWELL_LONG_TESTS ? kinds : kinds.filter((kind) => kind !== "fallback");

  it.each(kinds)("%s: adds reflectance · field · colour · intensity, and frees what it made", async (kind) => {
    for (const weights of ["inline", "texture"] as const) {
      const { data, backend: found, memory } = await draw(kind, room({ fields: [linearField(), stillField()] }), { weights, twice: true });
      expect(found).toBe(kind === "webgpu" ? "webgpu" : "webgl");
      for (let y = 20; y < 52; y += 8) {
        for (let x = 34; x < 62; x += 7) {
          const field = linearRadiance(backWallPoint(x, y, WIDTH, HEIGHT, -1), LAMP.initial);
          field.forEach((value, c) => {
            const expected = REFLECTANCE * (value * LAMP.color[c]! * LAMP.intensity + STILL[c]!);
            expect(Math.abs(data[4 * (y * WIDTH + x) + c]! / expected - 1)).toBeLessThan(2e-3);
          });
        }
      }
      const [before, there, after] = memory;
      expect(after).toEqual(before);
      expect(there!.geometries).toBeGreaterThan(before!.geometries);
    }
  });

  it.each(adapters)("%s: shows the light of an environment map that turns, which casts no shadow", async (kind) => {
    const map = { kind: "environment", name: "environment", range: [0, 360], initial: [0, 0, -1], intensity: 2, color: [1, 0.5, 1] };
    const tamper: Fixture["tamper"] = (json) => {
      const { extensions } = json as unknown as { extensions: Record<string, object> };
      Object.assign(extensions.LIGHTWELL_neural_radiance!, { version: 2, environment: { radiance: [1, 1, 1] } });
    };
    const glb = room({ variables: [map] as never, fields: [linearField()], tamper });
    const { data } = await draw(kind, glb, { parts: { raster: false, indirect: true, still: false } });
    const field = linearRadiance(backWallPoint(48, 36, WIDTH, HEIGHT, -1), [0, 0, -1]);
    field.forEach((value, c) => {
      expect(Math.abs(data[4 * (36 * WIDTH + 48) + c]! / (REFLECTANCE * value * 2 * map.color[c]!) - 1)).toBeLessThan(2e-3);
    });
  });

  it.each(adapters)("%s: sums over added lamps, without the rasterised light where it is not asked for", async (kind) => {
    const glb = room({ fields: [linearField(), stillField()] });
    const parts = { raster: false, indirect: true, still: false };
    const { data, lamps } = await draw(kind, glb, { added: 2, parts });
    expect(lamps).toHaveLength(3);
    expect(lamps[1]!.intensity).toBe(LAMP.intensity / 2);
    for (const [x, y] of [[36, 24], [48, 36], [58, 46]] as const) {
      const point = backWallPoint(x, y, WIDTH, HEIGHT, -1);
      for (const c of [0, 1, 2]) {
        const sum = lamps.reduce((total, { value, color, intensity }) => total + linearRadiance(point, value)[c]! * color[c]! * intensity, 0);
        expect(Math.abs(data[4 * (y * WIDTH + x) + c]! / (REFLECTANCE * sum) - 1)).toBeLessThan(2e-3);
      }
    }
    // Direct light alone adds to what is learned up to the whole.
    const whole = await draw(kind, glb, { direct: true });
    const [learned, raster] = [await draw(kind, glb, { parts: { ...parts, still: true } }), await draw(kind, glb, { parts: { raster: true, indirect: false, still: false } })];
    const at = 4 * (36 * WIDTH + 48);
    expect(raster.data[at]).toBeGreaterThan(0.05);
    expect(learned.data[at]! + raster.data[at]!).toBeCloseTo(whole.data[at]!, 4);
  });

  it.each(adapters)("%s: edits of the file's materials show, and detached it is as it was loaded", async (kind) => {
    const glb = room({ fields: [stillField()], variables: [] });
    const middle = ({ data }: Answer) => data.slice(4 * (36 * WIDTH + 48), 4 * (36 * WIDTH + 48) + 3);
    const [plain, lit] = [middle(await draw(kind, glb)), middle(await draw(kind, glb, { edit: "emissive" }))];
    expect(lit[0]! - plain[0]!).toBeCloseTo(0.5, 3);
    expect(lit[1]).toBeCloseTo(plain[1]!, 4);
    expect(plain[1]).toBeGreaterThan(0.02);
    expect(middle(await draw(kind, glb, { edit: "detached" }))).toEqual([0, 0, 0]);
  });

  it.each(adapters)("%s: attached again after a frame without it, it follows its lamps", async (kind) => {
    const glb = room({ fields: [linearField()] });
    const [once, twice] = [await draw(kind, glb, { direct: true }), await draw(kind, glb, { direct: true, edit: "attached" })];
    const at = 4 * (36 * WIDTH + 48);
    for (const c of [0, 1, 2]) expect(twice.data[at + c]! / once.data[at + c]!).toBeCloseTo(2, 2);
  });

  // Which renderer draws must not show: three.js' own surface model is another one, and changes from version to version.
  it.each(adapters.filter((kind) => kind !== "webgl"))("%s: direct light on matte, glossy, coated and metallic surfaces is that of WebGLRenderer", async (kind) => {
    const surface = (metallicFactor: number, roughnessFactor: number, extensions = {}) => ({
      pbrMetallicRoughness: { baseColorFactor: [0.6, 0.4, 0.2, 1], metallicFactor, roughnessFactor },
      extensions,
    });
    const materials = [matte(...WHITE), surface(0, 0.4), surface(1, 0.5), surface(0, 0.8, { KHR_materials_clearcoat: { clearcoatFactor: 1, clearcoatRoughnessFactor: 0.3 } })];
    const balls = [-0.6, 0, 0.6].map((x, i) => ball(i + 1, [x, 0.8, 0], 0.27));
    const glb = writeGlb({ ...plainRoom({ fields: [stillField()] }), meshes: [quad(0, [-1, 0, -1], [2, 0, 0], [0, 2, 0]), ...balls], materials });
    const parts = { raster: true, indirect: false, still: false };
    const [found, expected] = [await draw(kind, glb, { parts }), await draw("webgl", glb, { parts })];
    const apart = expected.data.map((x, i) => (i % 4 === 3 ? 0 : Math.abs(found.data[i]! - x) / Math.max(0.05, x)));
    // At the rims of balls and shadows, renderers may disagree on who owns a pixel.
    expect(apart.filter((x) => x > 0.02).length / apart.length).toBeLessThan(0.01);
    // The upper halves, which the lamp lights.
    const lit = (data: number[], x: number) => data[4 * (36 * WIDTH + x)]!;
    for (const x of [32, 48, 64]) expect(lit(expected.data, x)).toBeGreaterThan(0.02);
  });

  // Half resolution and the picture of segments.
  it.each(adapters)("%s: every look is that of WebGLRenderer", async (kind) => {
    // A sheet before the back wall, parallel to it, with slanted edges.
    const sheet = quad(0, [-0.6, 0.5, 0.3], [0.55, 0.1, 0], [-0.1, 0.9, 0]);
    const experts = { ...expertField(), variable: 0 };
    const glb = room({ fields: [experts], meshes: [...plainRoom().meshes!, sheet] });
    const smooth = room({ fields: [linearField()], meshes: [...plainRoom().meshes!, sheet] });
    const apart = (a: number[], b: number[]) => a.filter((x, i) => i % 4 < 3 && Math.abs(x - b[i]!) > 0.03 * Math.max(0.05, b[i]!)).length / a.length;
    const parts = { raster: false, indirect: true, still: false };
    const [segments, half] = [
      { parts, look: { half: false, segments: true } },
      { parts, look: { half: true, segments: false } },
    ];
    const full = await draw(kind, smooth, { parts });
    const small = await draw(kind, smooth, half);
    // Along edges of the sheet a small picture cannot know all of it.
    expect(apart(small.data, full.data)).toBeLessThan(0.04);
    expect(small.data).not.toEqual(full.data);
    const painted = await draw(kind, glb, segments);
    expect(new Set(painted.data.map((x) => x.toFixed(2))).size).toBeGreaterThan(8);
    if (kind === "webgl") return;
    expect(apart(small.data, (await draw("webgl", smooth, half)).data)).toBeLessThan(0.01);
    expect(apart(painted.data, (await draw("webgl", glb, segments)).data)).toBeLessThan(0.02);
    const { memory: [before, , after] } = await draw(kind, smooth, { ...half, twice: true });
    expect(after).toEqual(before);
  });

  it.each(adapters)("%s: follows its root", async (kind) => {
    const glb = room({ fields: [linearField(), stillField()] });
    const [home, away] = [await draw(kind, glb, { direct: true }), await draw(kind, glb, { direct: true, moved: true })];
    const wrong = home.data.filter((x, i) => Math.abs(x - away.data[i]!) > 0.01 * Math.max(0.2, x)).length;
    expect(wrong / home.data.length).toBeLessThan(0.02);
    expect(Math.max(...home.data.filter((_, i) => i % 4 < 3))).toBeGreaterThan(0.3);
  });

  it.each(adapters)("%s: a node that moves takes the field's rest position along, and its pose", async (kind) => {
    // Two panels of one material; the right one slides up by half a metre.
    const slide = { name: "Slide", kind: "node", node: 1, path: "translation", axis: [0, 1, 0], range: [0, 1], unit: "metres", initial: 0 };
    const graph = {
      version: 1,
      inputs: { rest_position: 3, rest_normal: 3, pose: 1 },
      nodes: [
        { id: "x", op: "affine", inputs: ["rest_position"], scale: [0.2, 0.2, 0.2], offset: [0.5, 0.1, 0.5] },
        { id: "n", op: "affine", inputs: ["rest_normal"], scale: [0, 0, 0.1], offset: [0, 0, 0] },
        { id: "xn", op: "add", inputs: ["x", "n"] },
        { id: "p", op: "affine", inputs: ["pose"], scale: [0.5], offset: [1], per_frame: true },
        { id: "ppp", op: "concat", inputs: ["p", "p", "p"], per_frame: true },
        { id: "y", op: "multiply", inputs: ["xn", "ppp"] },
      ],
      outputs: { radiance: "y" },
    };
    const panels = [-1, 0].map((x) => quad(0, [x, 0.5, -1], [1, 0, 0], [0, 1, 0]));
    const glb = writeGlb({ meshes: panels, materials: [matte(...WHITE)], variables: [slide], fields: [{ name: "moved", role: "static", graph }], tamper: asVersion2 });
    const { data } = await draw(kind, glb, { movers: { Slide: 0.5 } });
    for (const [x, y] of [[40, 36], [56, 20], [56, 30]] as const) {
      const [px, py, pz] = backWallPoint(x, y, WIDTH, HEIGHT, -1) as [number, number, number];
      const rest = [px, py - (px > 0 ? 0.5 : 0), pz];
      const expected = rest.map((value, c) => REFLECTANCE * 1.25 * (0.2 * value + [0.5, 0.1, 0.5][c]! + (c === 2 ? 0.1 : 0)));
      expected.forEach((value, c) => expect(Math.abs(data[4 * (y * WIDTH + x) + c]! / value - 1)).toBeLessThan(3e-3));
    }
  });

  it.each(adapters)("%s: bends the normal by the normal map, on either side of a sheet", async (kind) => {
    for (const back of [false, true]) {
      const { data } = await draw(kind, relief(back));
      for (const [x, y] of [[40, 30], [50, 40], [58, 24]] as const) {
        const found = [0, 1, 2].map((c) => data[4 * (y * WIDTH + x) + c]! / REFLECTANCE);
        // The back of a bump is a dent.
        const signs = back ? [-1, -1, 1] : [1, 1, 1];
        BENT.forEach((n, c) => expect(Math.abs(found[c]! - (0.5 + 0.4 * signs[c]! * n))).toBeLessThan(1e-3));
      }
    }
  });

  it.each(adapters.filter((kind) => kind !== "webgl"))("%s: `learnedRadiance` is the field in a material of the page's own", async (kind) => {
    const { data } = await draw(kind, room({ fields: [linearField()] }), { node: 0 });
    const field = linearRadiance(backWallPoint(48, 36, WIDTH, HEIGHT, -1), LAMP.initial);
    field.forEach((value, c) => expect(data[4 * (36 * WIDTH + 48) + c]! / value).toBeCloseTo(1, 2));
  });

  // Filtering an environment map takes half a minute without a GPU.
  it.each(process.env.LIGHTWELL_LONG_TESTS ? adapters : [])("%s: leaves the light of an environment map out unless it is asked for", async (kind) => {
    const glb = room({ fields: [stillField()], variables: [] });
    const middle = ({ data }: Answer) => data[4 * (36 * WIDTH + 48)]!;
    const [none, removed, kept] = [await draw(kind, glb), await draw(kind, glb, { environment: "remove" }), await draw(kind, glb, { environment: "keep" })].map(middle);
    expect(removed).toBeCloseTo(none!, 5);
    expect(kept).toBeGreaterThan(none! + 0.2);
  }, 240_000);

  it.each(adapters)("%s: samples pictures, the way up and the colours that they were written in", async (kind) => {
    const camera = { position: [0.4, 1.1, 2.6], target: [0, 0.7, -0.4], fovY: 45 } as Request["camera"];
    const { data, memory } = await draw(kind, LIGHTMAP, { camera, twice: true });
    const reference = await draw("webgl", LIGHTMAP, { camera, weights: "texture" });
    const covered = data.filter((_, i) => i % 4 === 3 && data[i]! > 0).length;
    expect(covered).toBeGreaterThan(0.2 * WIDTH * HEIGHT);
    let worst = 0;
    for (let i = 0; i < data.length; i++) {
      const [x, y] = [(i >> 2) % WIDTH, Math.floor((i >> 2) / WIDTH)];
      // Where the two squares meet and end, renderers may disagree on who owns a pixel.
      if (x < 2 || y < 2 || reference.data[i]! === 0 || data[i] === 0) continue;
      worst = Math.max(worst, Math.abs(data[i]! - reference.data[i]!) / Math.max(0.05, reference.data[i]!));
    }
    expect(worst).toBeLessThan(0.05);
    expect(memory[2]).toEqual(memory[0]);
    expect(memory[1]!.textures).toBeGreaterThanOrEqual(memory[0]!.textures + 2);
  });
});
