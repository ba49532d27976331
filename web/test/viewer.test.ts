/** The built page in a real browser, held against closed forms; on the faster software rasteriser, and with `LIGHTWELL_LONG_TESTS=1` on both. */

import { readFileSync } from "node:fs";
import type { Browser, Page } from "playwright-core";
import { afterAll, afterEach, beforeAll, describe, expect, it } from "vitest";
import type { Mode } from "../viewer/src/modes.ts";
import { BACKENDS, type Backend, launch, openPage, Site } from "./support/browser.ts";
import {
  CAMERA,
  furnishedRoom,
  LAMP,
  linearField,
  linearRadiance,
  plainRoom,
  STILL,
  stillField,
  WHITE,
} from "./support/fixtures.ts";
import { ball, type Fixture, type FixtureField, quad, writeGlb } from "./support/glb.ts";
import { backWallPoint, lambert, srgb255 } from "./support/optics.ts";
import { BUILT_PAGE, packReference, pageWith } from "./support/page.ts";

const [WIDTH, HEIGHT] = [128, 96];
const QUERY = `?size=${WIDTH}x${HEIGHT}&ui=0&tonemap=none&exposure=1&dither=0&samples=0`;
/** Half floats keep 11 bits; two roundings and fast division of the rasterisers stay below this. */
const HALF_STEP = 2 ** -9;
/** Reflectance of the white walls: base colour + 0.04. */
const REFLECTANCE = WHITE[0] + 0.04;

type Radiance = (x: number, y: number) => number[];

/** Fields of files that carry lights of their own. */
const FIELDS = process.env.LIGHTWELL_LONG_TESTS ? [[linearField()], [linearField(), stillField()]] : [[linearField(), stillField()]];

const RASTERISERS: Backend[] = process.env.LIGHTWELL_LONG_TESTS ? (Object.keys(BACKENDS) as Backend[]) : ["llvmpipe"];

describe.each(RASTERISERS)("the page on %s", (backend) => {
  let browser: Browser;
  const site = new Site();
  let count = 0;
  /** Every test of another fixture loads it here. */
  let tab: { page: Page; errors: string[] };
  /** The plain room, for tests that change modes and lights alone. */
  let plain: { page: Page; errors: string[] } | null = null;

  beforeAll(async () => {
    browser = await launch(backend);
    await site.open();
    tab = await openPage(browser, WIDTH, HEIGHT);
  });

  afterAll(async () => {
    await browser?.close();
    await site.close();
  });

  afterEach(() => {
    expect([...tab.errors.splice(0), ...(plain?.errors ?? [])]).toEqual([]);
  });

  async function load({ page }: { page: Page }, fixture: Fixture, query: string, data: unknown): Promise<Page> {
    await page.goto(site.put(`/${++count}.html`, pageWith(writeGlb(fixture), data)) + query);
    await page.evaluate(() => window.lightwell.ready);
    return page;
  }

  const open = (fixture: Fixture, query = QUERY, data: unknown = { title: "Fixture", home: CAMERA }) => load(tab, fixture, query, data);

  async function openPlain(): Promise<Page> {
    if (!plain) {
      plain = await openPage(browser, WIDTH, HEIGHT);
      await load(plain, plainRoom(), QUERY, { title: "Fixture", home: CAMERA });
    }
    await plain.page.evaluate((light) => void window.lightwell.setLight(light), LAMP.initial as [number, number, number]);
    return plain.page;
  }

  async function radiance(page: Page): Promise<Radiance> {
    // On llvmpipe (Mesa 22.3) the first read-back of a page shows, once in forty openings, the picture of the mode before,
    // whatever was drawn in between; beside other work the second one did, too. SwiftShader has no such thing.
    const read = () => page.evaluate(() => Array.from(window.lightwell.readRadiance().data));
    await read();
    let [before, data] = [await read(), await read()];
    for (let k = 0; k < 3 && data.some((value, i) => value !== before[i]); k++) [before, data] = [data, await read()];
    return (x, y) => data.slice(4 * (y * WIDTH + x), 4 * (y * WIDTH + x) + 4);
  }

  const setMode = (page: Page, mode: Mode) => page.evaluate((name) => window.lightwell.setMode(name), mode);

  /** Pixels well inside the back wall. */
  function* backWall(step = 8): Generator<[number, number]> {
    for (let y = 24; y < 72; y += step) for (let x = 40; x < 88; x += step) yield [x, y];
  }

  it("adds reflectance · field · colour · intensity", async () => {
    const page = await openPlain();
    await setMode(page, "indirect");
    const at = await radiance(page);
    for (const [x, y] of backWall()) {
      const field = linearRadiance(backWallPoint(x, y, WIDTH, HEIGHT, -1), LAMP.initial);
      field.forEach((value, c) => {
        const expected = REFLECTANCE * value * LAMP.color[c]! * LAMP.intensity;
        expect(Math.abs(at(x, y)[c]! / expected - 1)).toBeLessThan(HALF_STEP);
      });
    }
  });

  it("encodes to sRGB within one step of 255", async () => {
    const page = await openPlain();
    await setMode(page, "indirect");
    const pixels = await page.evaluate(() => Array.from(window.lightwell.readPixels().data));
    for (const [x, y] of backWall()) {
      const field = linearRadiance(backWallPoint(x, y, WIDTH, HEIGHT, -1), LAMP.initial);
      field.forEach((value, c) => {
        const expected = srgb255(REFLECTANCE * value * LAMP.color[c]! * LAMP.intensity);
        expect(Math.abs(pixels[4 * (y * WIDTH + x) + c]! - expected)).toBeLessThanOrEqual(1);
      });
    }
  });

  it("lights a Lambertian wall by the inverse square, without acne", async () => {
    const page = await openPlain();
    await setMode(page, "direct");
    for (const light of [LAMP.initial, [0.7, 0.3, -0.75], [-0.8, 1.7, 0.8]] as [number, number, number][]) {
      await page.evaluate((value) => window.lightwell.setLight(value), light);
      const at = await radiance(page);
      for (const [x, y] of backWall(3)) {
        const point = backWallPoint(x, y, WIDTH, HEIGHT, -1);
        const expected = lambert(WHITE[0], LAMP.intensity, light, point, [0, 0, 1]);
        expect(Math.abs(at(x, y)[0]! / expected - 1)).toBeLessThan(0.01);
      }
    }
  });

  it("lights by the inverse square nearer than 0.1 m, where three.js stops", async () => {
    const base = plainRoom();
    const page = await open({ ...base, meshes: [...base.meshes, quad(0, [-0.5, 0.5, -0.86], [1, 0, 0], [0, 1, 0])] });
    await setMode(page, "direct");
    const light: [number, number, number] = [0, 1, -0.8];
    await page.evaluate((value) => window.lightwell.setLight(value), light);
    const at = await radiance(page);
    const points = [...backWall(1)].map((pixel) => ({ pixel, point: backWallPoint(...pixel, WIDTH, HEIGHT, -0.86) }));
    const near = points.filter(({ point }) => Math.hypot(...point.map((value, k) => value - light[k]!)) < 0.09);
    expect(near.length).toBeGreaterThan(8);
    for (const { pixel, point } of near) {
      const expected = lambert(WHITE[0], LAMP.intensity, light, point, [0, 0, 1]);
      expect(Math.abs(at(...pixel)[0]! / expected - 1)).toBeLessThan(0.02);
    }
  });

  it("casts the shadow of a thin sheet to its foot, from either side", async () => {
    const sheets = [quad(0, [0, 0, 1], [0, 0, -2], [0, 2, 0]), quad(0, [0, 0, -1], [0, 0, 2], [0, 2, 0])];
    for (const sheet of sheets) {
      const base = plainRoom();
      const page = await open({ ...base, meshes: [...base.meshes, sheet] });
      await setMode(page, "direct");
      await page.evaluate(() => window.lightwell.setLight([0.6, 1, 0]));
      const at = await radiance(page);
      for (let y = 20; y < 76; y += 2) {
        for (let x = 66; x < 86; x += 4) expect(at(x, y)[0]!).toBeGreaterThan(0.05);
        for (let x = 42; x < 63; x += 2) expect(at(x, y)[0]!).toBe(0);
      }
    }
  });

  it("shows a shadow behind a box, and a picture that is not blank", async () => {
    const page = await open(furnishedRoom());
    await page.evaluate(() => window.lightwell.setLight([0.7, 1.2, 0.7]));
    const at = await radiance(page);
    const values = Array.from({ length: WIDTH * HEIGHT }, (_, i) => at(i % WIDTH, Math.floor(i / WIDTH))[1]!);
    expect(new Set(values).size).toBeGreaterThan(1000);
    await setMode(page, "direct");
    const direct = await radiance(page);
    const dark = [...backWall(2)].filter(([x, y]) => direct(x, y)[0] === 0).length;
    expect(dark).toBeGreaterThan(20);
    expect(dark).toBeLessThan(400);
    expect((await page.evaluate(() => window.lightwell.stats())).contextLost).toBe(false);
  });

  it("lights by a sun in lux", async () => {
    const [c, s] = [Math.cos(0.6), Math.sin(0.6)];
    const sun = {
      name: "sun",
      kind: "sun",
      start: [s, 0, c],
      middle: [0, 0, 1],
      end: [-s, 0, c],
      initial: [s, 0, c],
      intensity: 3,
      color: [1, 1, 1],
    };
    const page = await open(plainRoom({ variables: [sun], fields: [stillField()] }));
    await setMode(page, "direct");
    const at = await radiance(page);
    // The right wall shades the right part of the back wall: 2 m · tan 0.6 of it.
    const edge = 1 - 2 * (s / c);
    for (const [x, y] of backWall(3)) {
      const [px] = backWallPoint(x, y, WIDTH, HEIGHT, -1);
      if (Math.abs(px - edge) < 0.03) continue;
      const expected = px < edge ? (WHITE[0] / Math.PI) * 3 * c : 0;
      expect(Math.abs(at(x, y)[0]! - expected)).toBeLessThan(0.005);
    }
  });

  it("adds the light of the scene's own emitters, and takes it away", async () => {
    const page = await open(plainRoom({ fields: [stillField()] }));
    await setMode(page, "indirect");
    await page.evaluate(() => window.lightwell.setIntensity(100));
    for (const [c, value] of (await radiance(page))(64, 48).slice(0, 3).entries()) {
      expect(Math.abs(value / (REFLECTANCE * STILL[c]!) - 1)).toBeLessThan(HALF_STEP);
    }
    await page.evaluate(() => window.lightwell.setStillLight(false));
    expect((await radiance(page))(64, 48).slice(0, 3)).toEqual([0, 0, 0]);
  });

  it("shows the reference upright, the difference, and leaves them when the light moves", async () => {
    const [w, h] = [64, 48];
    const reference = new Float32Array(w * h * 3);
    for (let i = 0; i < w * h; i++) {
      // Red falls from the top, green grows to the right, blue is flat.
      const value = [1 - Math.floor(i / w) / h, (i % w) / w, 0.25];
      for (let c = 0; c < 3; c++) reference[3 * i + c] = value[c]!;
    }
    const view = {
      name: "One",
      camera: CAMERA,
      light: [0.2, 1, 0.2],
      width: w,
      height: h,
      ...packReference(reference, w),
    };
    const page = await open(plainRoom(), QUERY, { title: "Fixture", home: CAMERA, views: [view] });
    await page.evaluate(() => window.lightwell.setView(0));
    await setMode(page, "reference");
    const pixels = await page.evaluate(() => Array.from(window.lightwell.readPixels().data));
    for (const [x, y] of [
      [20, 10],
      [100, 10],
      [64, 90],
    ] as const) {
      const expected = [1 - ((y + 0.5) / HEIGHT - 0.5 / h), (x + 0.5) / WIDTH - 0.5 / w, 0.25];
      expected.forEach((value, c) => {
        expect(Math.abs(pixels[4 * (y * WIDTH + x) + c]! - srgb255(value))).toBeLessThan(1.5);
      });
    }
    await setMode(page, "difference");
    const compared = await page.evaluate(() => {
      window.lightwell.renderOnce();
      return window.lightwell.stats();
    });
    expect(compared.mode).toBe("difference");
    expect(compared.lights[0]).toEqual([0.2, 1, 0.2]);
    expect(compared.comparison!.relativeError).toBeGreaterThan(0.1);
    await page.evaluate(() => window.lightwell.setLight([0.3, 1, 0.2]));
    const moved = await page.evaluate(() => window.lightwell.stats());
    expect(moved).toMatchObject({ mode: "learned", view: null });
    expect(moved.notice).toContain("saved views");
  });

  it("shows silhouettes of the reference before an empty background without dark fringes", async () => {
    const base = plainRoom();
    const alone = { ...base, meshes: [ball(0, [0, 1, 0], 0.5)] };
    const smooth = QUERY.replace("samples=0", "samples=4");
    const first = await open(alone, smooth, { title: "Fixture", home: CAMERA });
    const { learned, radiance } = await first.evaluate(() => {
      const radiance = window.lightwell.readRadiance();
      return { learned: Array.from(window.lightwell.readPixels().data), radiance: Array.from(radiance.data) };
    });
    // What a path tracer's picture has at a silhouette: light times coverage, before a trace of light by the denoiser.
    const rgb = Float32Array.from({ length: 3 * WIDTH * HEIGHT }, (_, i) => Math.max(radiance[4 * Math.floor(i / 3) + (i % 3)]!, 1e-4));
    const partly = radiance.filter((value, i) => i % 4 === 3 && value > 0.05 && value < 0.95).length;
    expect(partly).toBeGreaterThan(20);
    const view = { name: "One", camera: CAMERA, light: LAMP.initial, width: WIDTH, height: HEIGHT, ...packReference(rgb, WIDTH) };
    const page = await open(alone, smooth, { title: "Fixture", home: CAMERA, views: [view] });
    await page.evaluate(() => window.lightwell.setView(0));
    await setMode(page, "reference");
    const shown = await page.evaluate(() => Array.from(window.lightwell.readPixels().data));
    expect(Math.max(...shown.map((value, i) => Math.abs(value - learned[i]!)))).toBeLessThanOrEqual(3);
  });

  it("adds none of the file's own lights, but what hangs on them", async () => {
    const open3 = async (change: Partial<Fixture>) => {
      const page = await open(plainRoom(change));
      await setMode(page, "direct");
      const at = await radiance(page);
      // A lost context reads as black.
      expect((await page.evaluate(() => window.lightwell.stats())).contextLost).toBe(false);
      return [...backWall(12)].flatMap(([x, y]) => at(x, y));
    };
    // A lamp beside the back wall, which hangs below it: without the wall, nothing but the void is seen.
    const tamper = (json: Parameters<NonNullable<Fixture["tamper"]>>[0]) => {
      const document = json as unknown as {
        nodes: object[];
        scenes: { nodes: number[] }[];
        extensionsUsed: string[];
        extensions: Record<string, unknown>;
      };
      const lights = [
        { type: "point", intensity: 50 },
        { type: "spot", intensity: 50 },
      ];
      document.extensions.KHR_lights_punctual = { lights };
      document.extensionsUsed.push("KHR_lights_punctual");
      document.nodes.push({ extensions: { KHR_lights_punctual: { light: 0 } }, children: [2] });
      document.nodes.push({ translation: [0, 1, 0.5], extensions: { KHR_lights_punctual: { light: 1 } } });
      document.scenes[0]!.nodes = [0, 1, 3, 4, 5, 6];
    };
    for (const fields of FIELDS) {
      const [with3, without] = [await open3({ fields, tamper }), await open3({ fields })];
      // Up to the last bit of a half float: the same walls are drawn in another order.
      const apart = with3.map((value, i) => Math.abs(value - without[i]!) / Math.max(without[i]!, 1e-3));
      expect(Math.max(...apart)).toBeLessThan(HALF_STEP);
      expect(Math.min(...without)).toBeGreaterThan(0);
    }
  });

  it("keeps weights in the shader up to a limit that depends on what draws", async () => {
    const zeros = (...shape: number[]) => ({
      shape,
      type: "float32" as const,
      values: new Float32Array(shape.reduce((x, y) => x * y)),
    });
    /** 3 → 64 → … → 64 → 3 with this many square layers. */
    const deep = (layers: number): FixtureField => {
      const widths = [3, ...Array(layers + 1).fill(64), 3] as number[];
      const buffers = widths.slice(1).flatMap((out, i) => [
        [`w${i}`, zeros(out, widths[i]!)],
        [`b${i}`, zeros(out)],
      ]);
      const nodes = widths.slice(1).map((_, i) => ({
        id: `h${i}`,
        op: "linear",
        inputs: [i === 0 ? "position" : `h${i - 1}`],
        weights: `w${i}`,
        bias: `b${i}`,
      }));
      const outputs = { radiance: `h${layers + 1}` };
      const graph = {
        version: 1,
        inputs: { position: 3 },
        buffers: Object.fromEntries(buffers),
        nodes,
        outputs,
      };
      return { role: "indirect", variable: 0, graph };
    };
    const weights = async (layers: number, query = QUERY.replace(/size=[^&]+/, "size=16x12")) => {
      const page = await open(plainRoom({ fields: [deep(layers)] }), query);
      const stats = await page.evaluate(() => window.lightwell.stats());
      expect(stats.macs).toBe(4096 * layers + 384);
      expect(stats.renderer.toLowerCase()).toContain(backend);
      return stats.weights;
    };
    expect(await weights(1)).toBe("inline");
    expect(await weights(4)).toBe("texture");
    expect(await weights(1, `${QUERY.replace(/size=[^&]+/, "size=16x12")}&weights=texture`)).toBe("texture");
  });

  it("keeps the light inside its box", async () => {
    const page = await openPlain();
    expect(await page.evaluate(() => window.lightwell.setLight([3, 1, 0]))).toBe(true);
    expect((await page.evaluate(() => window.lightwell.stats())).lights[0]).toEqual([0.8, 1, 0]);
    expect(await page.evaluate(() => window.lightwell.setLight([0.1, 1, 0]))).toBe(false);
  });

  it("goes on with direct light when the learned light does not compile", async () => {
    const other = await openPage(browser, WIDTH, HEIGHT);
    await other.page.addInitScript(() => {
      const { shaderSource } = WebGL2RenderingContext.prototype;
      WebGL2RenderingContext.prototype.shaderSource = function (shader, source) {
        shaderSource.call(
          this,
          shader,
          source.includes("lightwellField0") ? `${source} syntax error` : source,
        );
      };
    });
    await load(other, plainRoom(), QUERY, { home: CAMERA });
    const at = await radiance(other.page);
    expect(at(64, 48)[0]).toBeGreaterThan(0.01);
    expect((await other.page.evaluate(() => window.lightwell.stats())).trouble).toContain("could not compile");
    expect(other.errors.some((text) => text.includes("syntax error"))).toBe(true);
    await other.page.close();
  });

  it("keeps a file that is dropped while it loads another", async () => {
    const other = await openPage(browser, WIDTH, HEIGHT);
    let answer = () => {};
    const asked = new Promise<void>((resolve) => void (answer = resolve));
    await other.page.route("**/slow.glb", async (route) => {
      await asked;
      await route.fulfill({ body: Buffer.from(writeGlb(plainRoom())), contentType: "model/gltf-binary" });
    });
    await other.page.goto(`${site.put("/empty.html", readFileSync(BUILT_PAGE, "utf8"))}${QUERY}&asset=slow.glb`);
    await other.page.evaluate((bytes) => {
      const dataTransfer = new DataTransfer();
      dataTransfer.items.add(new File([Uint8Array.from(atob(bytes), (c) => c.charCodeAt(0))], "dropped.glb"));
      dispatchEvent(new DragEvent("drop", { dataTransfer }));
    }, Buffer.from(writeGlb(plainRoom())).toString("base64"));
    const title = () => other.page.evaluate(() => window.lightwell.stats().title);
    await expect.poll(title).toBe("dropped");
    answer();
    await other.page.evaluate(() => window.lightwell.ready);
    expect([await title(), other.errors]).toEqual(["dropped", []]);
    await other.page.close();
  });

  it("says so when the graphics context is lost, and comes back", async () => {
    const page = await open(plainRoom());
    const before = (await radiance(page))(64, 48);
    await page.evaluate(async () => {
      const gl = (document.getElementById("stage") as HTMLCanvasElement).getContext("webgl2")!;
      const extension = gl.getExtension("WEBGL_lose_context")!;
      const canvas = document.getElementById("stage")!;
      const lost = new Promise((resolve) => canvas.addEventListener("webglcontextlost", resolve));
      extension.loseContext();
      await lost;
      (window as unknown as { restore: () => void }).restore = () => extension.restoreContext();
    });
    expect(await page.evaluate(() => window.lightwell.stats())).toMatchObject({ contextLost: true });
    expect(await page.locator("[role=alert]").innerText()).toContain("context was lost");
    await page.evaluate(async () => {
      const restored = new Promise((resolve) => {
        document.getElementById("stage")!.addEventListener("webglcontextrestored", resolve);
      });
      // A context may be restored only after the event of its loss has been handled.
      setTimeout(() => (window as unknown as { restore: () => void }).restore(), 50);
      await restored;
    });
    expect((await radiance(page))(64, 48)).toEqual(before);
    tab.errors.length = 0;
  });
});
