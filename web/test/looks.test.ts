/** Several lamps, half resolution and experts in the built page, held against closed forms. */

import type { Browser, Page } from "playwright-core";
import { afterAll, afterEach, beforeAll, expect, it } from "vitest";
import { evaluate, type Graph, readGraph, type StoredBuffer } from "../runtime/src/graph/index.ts";
import { SEGMENT_COLORS } from "../runtime/src/segment-colors.ts";
import { readLights } from "../viewer/src/light-options.ts";
import type { Mode } from "../viewer/src/modes.ts";
import { launch, openPage, Site } from "./support/browser.ts";
import { BAND, expertField } from "./support/experts.ts";
import { CAMERA, LAMP, MATERIALS, plainRoom, room, WHITE } from "./support/fixtures.ts";
import { type Fixture, type FixtureField, quad, writeGlb } from "./support/glb.ts";
import { backWallPoint, lambert } from "./support/optics.ts";
import { pageWith } from "./support/page.ts";

const [WIDTH, HEIGHT] = [128, 96];
const QUERY = `?size=${WIDTH}x${HEIGHT}&ui=0&tonemap=none&exposure=1&dither=0&samples=0`;
const REFLECTANCE = WHITE[0] + 0.04;

let browser: Browser;
let tab: { page: Page; errors: string[] };
const site = new Site();

beforeAll(async () => {
  browser = await launch("llvmpipe");
  await site.open();
  tab = await openPage(browser, WIDTH, HEIGHT);
});

afterAll(async () => {
  await browser?.close();
  await site.close();
});

afterEach(() => {
  expect(tab.errors.splice(0)).toEqual([]);
});

async function load({ page }: { page: Page }, fixture: Fixture, query = QUERY): Promise<Page> {
  await page.goto(site.put("/page.html", pageWith(writeGlb(fixture), { home: CAMERA })) + query);
  await page.evaluate(() => window.lightwell.ready);
  return page;
}

const open = (fixture: Fixture, query = QUERY) => load(tab, fixture, query);

type Radiance = (x: number, y: number) => number[];

async function radiance(page: Page, mode: Mode): Promise<Radiance> {
  await page.evaluate((name) => window.lightwell.setMode(name), mode);
  await expect.poll(() => page.evaluate(() => window.lightwell.stats().preparing)).toBe(false);
  // The first frame with other lamps may still wait for their shadow maps.
  await page.evaluate(() => window.lightwell.renderOnce());
  const data = await page.evaluate(() => Array.from(window.lightwell.readRadiance().data));
  return (x, y) => data.slice(4 * (y * WIDTH + x), 4 * (y * WIDTH + x) + 3);
}

/** Components of the per-frame value of `frameField`: 36 blocks, which for four lamps no uniform array takes. */
const FRAME_WIDTH = 3 * 2 * 24;

/** A field whose light enters through per-frame values alone. */
function frameField(): FixtureField {
  const inputs = 3 + FRAME_WIDTH;
  const values = Float32Array.from({ length: 3 * inputs }, (_, i) => 0.004 * Math.sin(1.7 * i));
  return {
    role: "indirect",
    variable: 0,
    graph: {
      version: 1,
      inputs: { position: 3, light: 3 },
      buffers: {
        w: { shape: [3, inputs], type: "float32", values },
        b: { shape: [3], type: "float32", values: [0.3, 0.3, 0.3] },
      },
      nodes: [
        { id: "code", op: "frequency", inputs: ["light"], octaves: 24, per_frame: true },
        { id: "all", op: "concat", inputs: ["position", "code"] },
        { id: "y", op: "linear", inputs: ["all"], weights: "w", bias: "b" },
      ],
      outputs: { radiance: "y" },
    },
  };
}

function graphOf({ graph }: FixtureField): Graph {
  const stored = Object.entries(graph.buffers!).map(([name, { values, ...buffer }]) => [
    name,
    { ...buffer, data: Float32Array.from(values) } as StoredBuffer,
  ]);
  return readGraph(graph, new Map(stored as [string, StoredBuffer][]));
}

/** Lamps of the test: position, linear colour, intensity. */
const LAMPS = [
  { light: [0.25, 1.5, 0.5], color: [1, 0.5, 0.25], intensity: 2 },
  { light: [-0.5, 1, 0.125], color: [0.25, 1, 0.5], intensity: 1 },
  { light: [0.5, 0.75, -0.25], color: [0.5, 0.25, 1], intensity: 3 },
  { light: [-0.25, 1.75, -0.5], color: [1, 1, 1], intensity: 0.5 },
] as const;

it("adds up lamps, their shadows and their fields, and takes them away", async () => {
  const field = frameField();
  const graph = graphOf(field);
  const page = await open(plainRoom({ fields: [field] }));
  const set = (index: number) =>
    page.evaluate(
      ([i, { light, color, intensity }]) => {
        window.lightwell.setLight([...light], i);
        window.lightwell.setColor([...color], i);
        window.lightwell.setIntensity(intensity, i);
      },
      [index, LAMPS[index]!] as const,
    );
  await set(0);
  const before = (await radiance(page, "learned"))(64, 48);
  // Two lamps are a uniform array, four of them a texture.
  for (const count of [2, 4]) {
    for (let i = (await page.evaluate(() => window.lightwell.stats())).lights.length; i < count; i++) {
      expect(await page.evaluate(() => window.lightwell.addLamp())).toBe(i);
      await set(i);
    }
    const [indirect, direct] = [await radiance(page, "indirect"), await radiance(page, "direct")];
    for (const [x, y] of [
      [44, 30],
      [64, 48],
      [84, 66],
    ] as const) {
      const point = backWallPoint(x, y, WIDTH, HEIGHT, -1);
      const lamps = LAMPS.slice(0, count);
      [0, 1, 2].forEach((c) => {
        const learned = lamps.reduce((sum, { light, color, intensity }) => {
          const value = evaluate(graph, { position: [...point], light: [...light] }).radiance![c]!;
          return sum + REFLECTANCE * Math.max(value, 0) * color[c]! * intensity;
        }, 0);
        const cast = lamps.reduce(
          (sum, { light, color, intensity }) =>
            sum + color[c]! * lambert(WHITE[0], intensity, light, point, [0, 0, 1]),
          0,
        );
        expect(indirect(x, y)[c]! / learned).toBeCloseTo(1, 2);
        expect(direct(x, y)[c]! / cast).toBeCloseTo(1, 1.7);
      });
    }
  }
  expect(await page.evaluate(() => window.lightwell.addLamp())).toBe(-1);
  for (const i of [3, 2, 1, 0]) await page.evaluate((index) => window.lightwell.removeLamp(index), i);
  expect((await page.evaluate(() => window.lightwell.stats())).lights).toEqual([[...LAMPS[0].light]]);
  await expect.poll(async () => (await radiance(page, "learned"))(64, 48)).toEqual(before);
});

it("reads lamps and half resolution from the address", async () => {
  const page = await open(plainRoom(), `${QUERY}&half=1&lights=0.5,1,0.25,ffffff,4;-0.5,1.5,0,ff0000,2`);
  const stats = await page.evaluate(() => window.lightwell.stats());
  expect(stats).toMatchObject({ half: true, lights: [[0.5, 1, 0.25], [-0.5, 1.5, 0]], preparing: false });
  // Two lamps at a quarter of the pixels.
  expect(stats.macs).toBe((18 * 2) / 4);
});

it("shows the learned light behind clear glass once", async () => {
  const glass = {
    pbrMetallicRoughness: { baseColorFactor: [1, 1, 1, 1], metallicFactor: 0, roughnessFactor: 0 },
    extensions: { KHR_materials_transmission: { transmissionFactor: 1 } },
  };
  const pane = quad(MATERIALS.length, [-0.8, 0.2, -0.3], [1.6, 0, 0], [0, 1.6, 0]);
  const bare = (await radiance(await open(plainRoom()), "learned"))(64, 48);
  const page = await open(plainRoom({ meshes: [...room(), pane], materials: [...MATERIALS, glass] }));
  const seen = (await radiance(page, "learned"))(64, 48);
  // 4 to 8 % are reflected, and the picture behind is blurred a little.
  for (const c of [0, 1, 2]) expect(seen[c]! / bare[c]!).toBeGreaterThan(0.85);
  for (const c of [0, 1, 2]) expect(seen[c]! / bare[c]!).toBeLessThan(1.1);
  // At half resolution the small picture shows what lies behind.
  await page.evaluate(() => window.lightwell.setHalf(true));
  const half = (await radiance(page, "learned"))(64, 48);
  for (const c of [0, 1, 2]) expect(half[c]! / seen[c]!).toBeCloseTo(1, 1);
  // What the glass reflects is added, where the file has it: this field is that of the wall behind, about the same again.
  const tamper = (json: any) => void (json.extensions.LIGHTWELL_neural_radiance.glass = true);
  const own = (await radiance(await open(plainRoom({ meshes: [...room(), pane], materials: [...MATERIALS, glass], tamper })), "learned"))(64, 48);
  for (const c of [0, 1, 2]) expect(own[c]! / seen[c]!).toBeGreaterThan(1.2);
});

it("takes malformed lamps for none", () => {
  expect(readLights("3")).toEqual([{}, {}, {}]);
  expect(readLights("9")).toHaveLength(4);
  expect(readLights("1, 2,-3")).toEqual([{ value: [1, 2, -3] }]);
  expect(readLights("1,2,3,00ff80,0.5")).toEqual([{ value: [1, 2, 3], color: "#00ff80", intensity: 0.5 }]);
  const malformed = ["x", "1,2", "1,2,,", "1,2,1e999", "1,2,3;", "1,2,3,red", "1,2,3,00ff80,-1", "1,2,3,000000,1,1"];
  for (const text of [null, "", ...malformed]) expect(readLights(text)).toEqual([]);
});

/** Radiance from about 0.05 at the back wall, z = −1, to 0.9 at z = 0.3: a leak over the edge would be seen. */
function depthField(): FixtureField {
  const slope = 0.85 / 1.3;
  const row = [0.01, 0.005, slope];
  return {
    role: "indirect",
    variable: 0,
    graph: {
      version: 1,
      inputs: { position: 3 },
      buffers: {
        w: { shape: [3, 3], type: "float32", values: [...row, ...row, ...row] },
        b: { shape: [3], type: "float32", values: Array(3).fill(0.05 + slope) as number[] },
      },
      nodes: [{ id: "y", op: "linear", inputs: ["position"], weights: "w", bias: "b" }],
      outputs: { radiance: "y" },
    },
  };
}

it("at half resolution, light stays on its side of a depth edge", async () => {
  // A sheet before the back wall, parallel to it, with slanted edges.
  const sheet = quad(0, [-0.6, 0.5, 0.3], [0.55, 0.1, 0], [-0.1, 0.9, 0]);
  const page = await open(plainRoom({ fields: [depthField()], meshes: [room()[2]!, sheet] }));
  const full = await radiance(page, "indirect");
  await page.evaluate(() => window.lightwell.setHalf(true));
  const half = await radiance(page, "indirect");
  let [worst, sum, count, edges] = [0, 0, 0, 0];
  for (let y = 1; y < HEIGHT - 1; y++) {
    for (let x = 1; x < WIDTH - 1; x++) {
      const [a, b] = [full(x, y)[0]!, half(x, y)[0]!];
      if (a === 0) {
        expect(b).toBe(0);
        continue;
      }
      const error = Math.abs(b - a) / a;
      worst = Math.max(worst, error);
      sum += error;
      count++;
      if (full(x + 1, y)[0]! > 3 * a || full(x - 1, y)[0]! > 3 * a) edges++;
    }
  }
  // The wall is up to 18 times darker than the sheet; a plain bilinear filter would be off by more than 100 % there.
  expect(edges).toBeGreaterThan(70);
  expect(worst).toBeLessThan(0.03);
  expect(sum / count).toBeLessThan(0.002);
  expect(sum).toBeGreaterThan(0);
  await page.evaluate(() => window.lightwell.setHalf(false));
  expect((await radiance(page, "indirect"))(64, 48)).toEqual(full(64, 48));
});

it("paints experts by number, stripes their border, and computes nothing of it before", async () => {
  const other = await openPage(browser, WIDTH, HEIGHT);
  const { page } = other;
  await page.addInitScript(() => {
    Object.assign(window, { painters: 0 });
    const { shaderSource } = WebGL2RenderingContext.prototype;
    WebGL2RenderingContext.prototype.shaderSource = function (shader, source) {
      if (source.includes("lightwellSegment")) (window as unknown as { painters: number }).painters++;
      shaderSource.call(this, shader, source);
    };
  });
  await load(other, plainRoom({ fields: [expertField()] }));
  const painters = () => page.evaluate(() => (window as unknown as { painters: number }).painters);
  const at = await radiance(page, "indirect");
  expect(await painters()).toBe(0);
  const painted = await radiance(page, "experts");
  expect(await painters()).toBeGreaterThan(0);
  const seen = new Set<number>();
  for (let x = 36; x < 92; x++) {
    const [px] = backWallPoint(x, 48, WIDTH, HEIGHT, -1);
    const expert = Math.floor((px + 1) * 2);
    const nearest = nearestColor(painted(x, 48));
    seen.add(nearest);
    if (Math.abs(px) > BAND) {
      expect(nearest).toBe(expert);
      expect(at(x, 48)[1]! / (REFLECTANCE * 0.05 * (expert + 1) * LAMP.intensity * LAMP.color[1]!)).toBeCloseTo(1, 2);
    }
  }
  expect([...seen]).toEqual(expect.arrayContaining([0, 1, 2, 3]));
  // In the band, both colours on either side of the border.
  for (const columns of [
    [58, 60, 62],
    [65, 67, 69],
  ]) {
    const found = columns.flatMap((x) => [40, 42, 44, 46, 48, 50].map((y) => nearestColor(painted(x, y))));
    expect(found).toEqual(expect.arrayContaining([1, 2]));
  }
  expect(other.errors).toEqual([]);
  await page.close();
});

/** The palette's colour of the same hue and saturation. */
function nearestColor(linear: readonly number[]): number {
  const unit = (v: readonly number[]) => v.map((x) => x / Math.hypot(...v));
  const seen = unit(linear);
  const away = SEGMENT_COLORS.map((hex) => {
    const color = unit([1, 3, 5].map((i) => (Number.parseInt(hex.slice(i, i + 2), 16) / 255) ** 2.2));
    return Math.hypot(...color.map((x, c) => x - seen[c]!));
  });
  return away.indexOf(Math.min(...away));
}
