/** What is looked at of a scene, and what is seen behind it: read, fitted to, drawn. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { clippingPlanes, type Environment, FormatError, PointLamp, readExtension, SkyBackground, SunLamp } from "lightwell";
import { Box3, DataUtils, Group, Vector3 } from "three";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, describe, expect, it } from "vitest";
import { coreOf } from "../runtime/src/core.ts";
import { Placement } from "../runtime/src/placement.ts";
import { LampSwitch } from "../runtime/src/switches.ts";
import { type PointVariable, readVariables, type SunVariable } from "../runtime/src/variables.ts";
import { launch, openPage, Site } from "./support/browser.ts";
import { LAMP, plainRoom, stillField } from "./support/fixtures.ts";
import { type Fixture, quad, writeGlb } from "./support/glb.ts";
import { pageWith } from "./support/page.ts";

const sources = { bufferView: async () => new ArrayBuffer(0), texture: async () => ({ source: null, width: 1, height: 1 }) };
const read = (extension: object, textures: object[] = []) =>
  readExtension({ textures, extensions: { LIGHTWELL_neural_radiance: { version: 1, variables: [], fields: [], ...extension } } } as never, sources);

describe("the extension", () => {
  it("may say what is looked at and what surrounds it", async () => {
    const core = { low: [-1, 0, -1], high: [1, 2, 1] };
    expect(await read({})).toMatchObject({ core: null, environment: null });
    expect(await read({ core, environment: { radiance: [1, 2, 3] } })).toMatchObject({ core, environment: { radiance: [1, 2, 3], texture: null, lamp: null } });
    expect(await read({ environment: { radiance: [1, 1, 1], texture: 0 } }, [{}])).toMatchObject({ environment: { texture: 0 } });
  });

  it.each([
    [{ core: { low: [0, 0, 0], high: [1, 0, 1] } }, "core: expected low below high"],
    [{ core: { low: [0, 0] } }, "core.low: expected three numbers"],
    [{ environment: { radiance: [1, -1, 1] } }, "environment.radiance[1]: expected a number in"],
    [{ environment: { radiance: [1, 1, 1], texture: 0 } }, "environment.texture: expected a number in"],
    [{ environment: { radiance: [1, 1, 1], lamp: 0 } }, "environment.lamp: expected a number in"],
  ])("refuses %j", async (extension, message) => {
    await expect(read(extension)).rejects.toThrow(FormatError);
    await expect(read(extension)).rejects.toThrow(message);
  });
});

const box = (half: number, x = 0) => new Box3(new Vector3(x - half, -half, -half), new Vector3(x + half, half, half));
const WIDE = box(1000, 200);

describe("lengths", () => {
  it("are those of the part that is looked at, and of all where the file names none", () => {
    expect(coreOf(null, WIDE)).toBe(WIDE);
    expect(coreOf({ low: [-1, -1, -1], high: [1, 1, 1] }, WIDE)).toEqual(box(1));
    expect(coreOf({ low: [5000, 0, 0], high: [5001, 1, 1] }, WIDE)).toBe(WIDE);
  });

  it("a camera draws what is near in the core, and all of the scene", () => {
    const [size, all] = [2 * Math.sqrt(3), 2000 * Math.sqrt(3)];
    const [near, far] = clippingPlanes(box(1), WIDE);
    expect(near).toBeCloseTo(2e-3 * size, 9);
    expect(far).toBeCloseTo(10 * size + 2 * all, 6);
    expect(clippingPlanes(box(1), box(1))).toEqual([2e-3 * size, 40 * size]);
  });

  it("a point light casts shadows from a near plane of the core to the end of the scene", () => {
    const lamp = new PointLamp(readVariables([LAMP], "variables")[0] as PointVariable, WIDE, new Placement(new Group()), box(2));
    expect(lamp.object.shadow.camera.near).toBeCloseTo(5e-4 * 4 * Math.sqrt(3), 9);
    expect(lamp.object.shadow.camera.far).toBeCloseTo(1.01 * 2000 * Math.sqrt(3), 6);
  });

  it("a sun's shadow map holds the core, and what lies before it", () => {
    const variable = readVariables([{ kind: "sun", name: "sun", start: [1, 0, 0], middle: [0, 1, 0], end: [-1, 0, 0], intensity: 1 }], "variables")[0] as SunVariable;
    const cameraOf = (sun: SunLamp) => sun.object.shadow.camera;
    const sun = new SunLamp(variable, WIDE, new Placement(new Group()), box(1));
    sun.move(new Vector3(1, 0, 0));
    const { right, top, near, far } = cameraOf(sun);
    // As the sun sees it, a box seen from a side is a square.
    expect([right, top]).toEqual([1.02, 1.02].map((x) => expect.closeTo(x, 9)));
    const distance = sun.object.position.distanceTo(sun.object.target.position);
    // Towards the sun the scene goes on for 1200, away from it the core for 1.
    expect(distance - near).toBeGreaterThan(1200);
    expect(far - distance).toBeCloseTo(1.102, 6);
    const plain = new SunLamp(variable, box(1), new Placement(new Group()));
    // Aslant, along an edge: the width of the box across it, and its diagonal.
    plain.move(new Vector3(1, 1, 0));
    expect(cameraOf(plain).right).toBeCloseTo(1.02 * Math.SQRT2, 9);
  });
});

describe("the picture behind a scene", () => {
  const texel = ({ texture }: SkyBackground, column: number, row: number) => {
    const { data, width } = texture.image as unknown as { data: Uint16Array; width: number };
    return [0, 1, 2, 3].map((c) => DataUtils.fromHalfFloat(data[4 * (row * width + column) + c]!));
  };

  it("is a constant sky, with its lamp, and nothing when what stands still is not shown", () => {
    const lamp = new LampSwitch({ name: "sky", nodes: [], intensity: 1, color: [1, 1, 1] });
    const sky = new SkyBackground({ radiance: [0.5, 1, 2], picture: null, lamp });
    expect(sky.update([])).toBe(true);
    for (const row of [0, 100, 255]) expect(texel(sky, 7, row)).toEqual([0.5, 1, 2, 1]);
    expect(sky.update([])).toBe(false);
    lamp.set({ intensity: 0.5, color: [1, 0, 1] });
    expect(sky.update([])).toBe(true);
    expect(texel(sky, 7, 0)).toEqual([0.25, 0, 1, 1]);
    expect(sky.update([], false)).toBe(true);
    expect(texel(sky, 7, 0)).toEqual([0, 0, 0, 1]);
  });

  it("is that of an environment, upright", () => {
    const picture = { width: 2, height: 2, texels: Float32Array.from([1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1]) };
    const sky = new SkyBackground({ radiance: [2, 2, 4], picture, lamp: null } satisfies Environment);
    sky.update([]);
    // The first row of a data texture is the lowest one.
    expect([texel(sky, 0, 1), texel(sky, 1, 1), texel(sky, 0, 0), texel(sky, 1, 0)]).toEqual([[2, 0, 0, 1], [0, 2, 0, 1], [0, 0, 4, 1], [2, 2, 4, 1]]);
  });
});

const [WIDTH, HEIGHT] = [64, 48];
const QUERY = `?size=${WIDTH}x${HEIGHT}&tonemap=none&exposure=1&dither=0&samples=0`;
/** Half floats keep 11 bits. */
const HALF_STEP = 2 ** -10;

describe("the page", () => {
  let browser: Browser;
  let tab: { page: Page; errors: string[] };
  const site = new Site();
  let count = 0;

  beforeAll(async () => {
    await site.open();
    browser = await launch("llvmpipe");
    tab = await openPage(browser, 640, 480);
  });

  afterAll(async () => {
    await browser?.close();
    await site.close();
    expect(tab.errors).toEqual([]);
  });

  const open = async (fixture: Fixture, query = `${QUERY}&ui=0`) => {
    await tab.page.goto(site.put(`/${++count}.html`, pageWith(writeGlb(fixture))) + query);
    await tab.page.evaluate(() => window.lightwell.ready);
    return tab.page;
  };
  const extended = (more: object, change: (json: any) => void = () => {}): Partial<Fixture> => ({
    tamper: (json: any) => {
      Object.assign(json.extensions.LIGHTWELL_neural_radiance, more);
      change(json);
    },
  });
  /** Radiance of the middle of the canvas, looking from a place in a direction. */
  const seen = (page: Page, from: number[], along: number[]) =>
    page.evaluate(
      ([eye, ahead]) => {
        window.lightwell.setCamera(eye!, eye!.map((x, i) => x + ahead![i]!), 40);
        const read = () => window.lightwell.readRadiance();
        // The first read-back may show the picture before (Mesa 22.3).
        read();
        const { width, height, data } = read();
        const at = 4 * ((height >> 1) * width + (width >> 1));
        return Array.from(data.slice(at, at + 4));
      },
      [from, along],
    );
  const near = (found: number[], wanted: number[]) => wanted.forEach((x, i) => expect(Math.abs(found[i]! - x)).toBeLessThanOrEqual(HALF_STEP * x + 1e-6));

  it("shows a constant sky of the file behind the scene, as long as light that stands still is on", async () => {
    const page = await open(plainRoom({ fields: [stillField()], ...extended({ environment: { radiance: [0.25, 0.5, 1.5] } }) }));
    for (const along of [[0, 0, 1], [1, 0.5, 1], [0, -1, 1]]) near(await seen(page, [0, 1, 3], along), [0.25, 0.5, 1.5, 1]);
    await page.evaluate(() => window.lightwell.setStillLight(false));
    near(await seen(page, [0, 1, 3], [0, 0, 1]), [0, 0, 0, 1]);
  });

  it("shows the picture of an environment where it was traced", async () => {
    const [width, height] = [64, 32];
    // Above red; below, one colour for each quarter of the horizon.
    const uri = await tab.page.evaluate(([w, h]) => {
      const canvas = Object.assign(document.createElement("canvas"), { width: w, height: h });
      const context = canvas.getContext("2d")!;
      const fill = (colour: string, x: number, y: number, wide: number, high: number) => {
        context.fillStyle = colour;
        context.fillRect(x, y, wide, high);
      };
      fill("#f00", 0, 0, w!, h! / 2);
      ["#0f0", "#00f", "#ff0", "#c8c8c8"].forEach((colour, k) => fill(colour, (k * w!) / 4, h! / 2, w! / 4, h! / 2));
      return canvas.toDataURL("image/png");
    }, [width, height]);
    const picture = (json: any) => Object.assign(json, { images: [{ uri }], textures: [{ source: 0 }] });
    const page = await open(plainRoom({ fields: [stillField()], ...extended({ environment: { radiance: [2, 2, 2], texture: 0 } }, picture) }));
    const eye = [0, 1, 30];
    near(await seen(page, eye, [1, 1, 1]), [2, 0, 0, 1]);
    // Columns go by atan2(z, x) from -π to π.
    for (const [along, colour] of [
      [[-1, -0.5, -1], [0, 2, 0, 1]],
      [[1, -0.5, -1], [0, 0, 2, 1]],
      [[1, -0.5, 1], [2, 2, 0, 1]],
    ] as const) near(await seen(page, eye, [...along]), [...colour]);
    const grey = await seen(page, eye, [-1, -0.5, 1]);
    // A byte is a logarithm: 14 factors of two from 255 to 0.
    near(grey, [1, 1, 1].map(() => 2 * 2 ** (14 * (200 / 255 - 1))));
  });

  it("a sky follows its sun", async () => {
    const { sky } = JSON.parse(readFileSync(fileURLToPath(new URL("../../tests/scenes/sky_vectors.json", import.meta.url)), "utf8")) as { sky: object };
    const sun = { kind: "sun", name: "day", start: [1, 0.05, 0], middle: [0, 0.9, 0.4], end: [-1, 0.05, 0], initial: [1, 0.05, 0], intensity: 2, color: [1, 1, 1], sky };
    const page = await open(plainRoom({ variables: [sun], fields: [stillField()], ...extended({ version: 2 }) }));
    const east = [0.8, 0.15, 0.3];
    const rise = await seen(page, [0, 1, 30], east);
    await page.evaluate(() => void window.lightwell.setLight([-1, 0.05, 0]));
    const set = await seen(page, [0, 1, 30], east);
    expect(rise[0]!).toBeGreaterThan(1.2 * set[0]!);
    expect(set[2]!).toBeGreaterThan(0);
  });

  it("a lamp's body has the size of a room, not of the dome of sky about it", async () => {
    const dome = quad(0, [-150, 80, -150], [300, 0, 0], [0, 0, 300]);
    const room = plainRoom();
    const meshes = [...room.meshes, dome];
    const place = [0, 1, 0];
    const beside = async (more: object) => {
      const page = await open({ ...room, meshes, ...extended(more) }, QUERY);
      await page.evaluate((at) => void window.lightwell.setLight(at), place);
      // Past the lamp, at a distance of 0.3 m.
      return seen(page, [0.3, 1, 5], [0, 0, -1]);
    };
    const [wide, core] = [await beside({}), await beside({ core: { low: [-1, 0, -1], high: [1, 2, 1] } })];
    // A ball has a radiance of 14.
    expect(wide[0]!).toBeGreaterThan(10);
    expect(core[0]!).toBeLessThan(10);
  });
});

it("the lens of the page shows the same sky, and follows it", async (context) => {
  const site = new Site();
  await site.open();
  const browser = await launch("swiftshader");
  const { page, errors } = await openPage(browser, WIDTH, HEIGHT);
  const glb = writeGlb(plainRoom({ fields: [stillField()], tamper: (json: any) => void (json.extensions.LIGHTWELL_neural_radiance.environment = { radiance: [0.25, 0.5, 1] }) }));
  await page.goto(site.put("/lens.html", pageWith(glb)) + `${QUERY}&ui=0`);
  await page.evaluate(() => window.lightwell.ready);
  const adapter = await page.evaluate(async () => Boolean(await navigator.gpu?.requestAdapter()));
  if (!adapter) context.skip("this browser has no WebGPU adapter");
  /** Red, green and blue of the middle, through the lens. */
  const shown = () =>
    page.evaluate(() => {
      const { data, width, height } = window.lightwell.readPixels();
      const at = 4 * ((height >> 1) * width + (width >> 1));
      return Array.from(data.slice(at, at + 3));
    });
  await page.evaluate(() => {
    window.lightwell.setCamera([0, 1, 3], [0, 1, 4], 40);
    return window.lightwell.setLens(true, { focus: 1, fstop: 4 });
  });
  // sRGB of 0.25, 0.5 and 1.
  (await shown()).forEach((x, i) => expect(Math.abs(x - [137, 188, 255][i]!)).toBeLessThan(3));
  await page.evaluate(() => {
    window.lightwell.setStillLight(false);
    return window.lightwell.setLens(true, { focus: 1.1, fstop: 4 });
  });
  (await shown()).forEach((x) => expect(x).toBeLessThan(3));
  expect(errors).toEqual([]);
  await browser.close();
  await site.close();
});
