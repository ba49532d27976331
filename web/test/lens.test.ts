/** The lens in the browser against the Python reference: integers bit for bit, pictures within tolerances, planted bugs found. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { gunzipSync } from "node:zlib";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, beforeEach, describe, expect, it } from "vitest";
import type { LensAnswer, LensRequest } from "./pages/lens.ts";
import { launch, openPage, Site } from "./support/browser.ts";
import { bundle, modulePage } from "./support/bundle.ts";

const file = (path: string) => readFileSync(fileURLToPath(new URL(path, import.meta.url)));
interface Packed {
  readonly shape: readonly [number, number, ...number[]];
  readonly type: "f4" | "i4";
  readonly data: string;
}
const CASES = JSON.parse(gunzipSync(file("fixtures/lens.json.gz")).toString()) as Record<"still" | "moving" | "frame", any> & Record<"disc" | "joint", string>;
const { disc, joint } = CASES;

function unpack({ type, data }: Packed): number[] {
  const raw = Buffer.from(data, "base64");
  const buffer = raw.buffer.slice(raw.byteOffset, raw.byteOffset + raw.length);
  return Array.from(type === "f4" ? new Float32Array(buffer) : new Int32Array(buffer));
}

/** Focus of `unitCamera`, and of depths for it. */
const FOCUS = 1e-2;
/** A camera with s = 1/FOCUS − 1/z px for pictures of a width, so that a depth exists for any s. */
function unitCamera(width: number) {
  const focal = FOCUS / 1000;
  const image = (focal * FOCUS) / (FOCUS - focal);
  const sensor = 0.036;
  return { focus: FOCUS, focal, sensor, fstop: ((focal / 2) * image * width) / sensor, shutter: 1 };
}
const depthOf = (s: number) => 1 / (1 / FOCUS - s);

let browser: Browser | undefined;
let page: Page;
let errors: string[] = [];
let adapter: string | null = null;
const site = new Site();

beforeAll(async () => {
  await site.open();
  browser = await launch("swiftshader");
  ({ page, errors } = await openPage(browser));
  await page.goto(site.put("/index.html", modulePage(await bundle("pages/lens.ts"))));
  await page.waitForFunction(() => window.lensReady);
  adapter = await page.evaluate(() => window.lensAdapter());
}, 90_000);

afterAll(async () => {
  await browser?.close();
  await site.close();
  expect(errors).toEqual([]);
});

beforeEach((context) => {
  if (!adapter) context.skip("this browser has no WebGPU adapter");
});

async function draw(request: LensRequest): Promise<LensAnswer> {
  const answer = await page.evaluate((r) => window.lensDraw(r), request);
  expect(answer.errors).toEqual([]);
  return answer;
}

/** The largest difference, and the decibels of two pictures held to [0, 1], RGB. */
function compare(ours: number[], theirs: number[]): { worst: number; psnr: number } {
  let [worst, square, count] = [0, 0, 0];
  const held = (v: number) => Math.min(1, Math.max(0, v));
  theirs.forEach((value, i) => {
    const error = Math.abs(ours[i]! - value);
    worst = Math.max(worst, Number.isFinite(error) ? error : Infinity);
    if (i % 4 === 3) return;
    square += (held(ours[i]!) - held(value)) ** 2;
    count++;
  });
  return { worst, psnr: Number.isFinite(worst) ? -10 * Math.log10(Math.max(square / count, 1e-20)) : 0 };
}

/** What the last pass does to one layer: light >= 0, and excess coverage divides it. */
function tidied(values: number[]): number[] {
  return values.map((value, i) => Math.max(value, 0) / Math.max(values[i - (i % 4) + 3]!, 1));
}

/** The integer planes of the device, [row][column][4], and the reference's laid out as they are: what leaves to the right comes back. */
function planes(answer: LensAnswer, reference: any) {
  const data = answer.buffers.image!;
  const [w, h] = answer.domain;
  const shift = answer.guard - reference.guard;
  return (["charges", "primal"] as const).map((name, plane) => {
    const found = Array.from({ length: 4 * w * h }, (_, i) => data[(plane * 2 + ((i >> 1) & 1)) * 2 * w * h + 2 * (i >> 2) + (i & 1)]!);
    const expected = new Array<number>(4 * w * h).fill(0);
    const [, columns] = reference[name].shape as number[];
    unpack(reference[name]).forEach((value, i) => {
      const [x, y] = [((i >> 2) % columns!) + shift, Math.floor((i >> 2) / columns!) + shift];
      if (value !== 0) expected[4 * (y * w + (x % w)) + (i & 3)]! += value;
    });
    return { found, expected };
  }) as [Planes, Planes];
}
type Planes = { found: number[]; expected: number[] };

const differing = (a: number[], b: number[]) => b.reduce((n, value, i) => n + Number(a[i] !== value), 0);

/** One layer, borders dark: what the reference's scatter and solve were given. */
function oneLayer(name: "still" | "moving", change: Partial<LensRequest> = {}): LensRequest {
  const { light, s, motion, number = 0 } = CASES[name];
  const [height, width] = light.shape;
  return {
    width,
    height,
    libraries: [name === "still" ? disc : joint],
    light: unpack(light),
    depth: unpack(s).map(depthOf),
    motion: motion ? unpack(motion) : null,
    options: { layers: 1, edges: "dark", largest: 12 },
    camera: unitCamera(width),
    frame: { opaque: false, number },
    ...change,
  };
}

/** The whole pipeline: two layers, borders extended. */
function twoLayers(change: Partial<LensRequest> = {}): LensRequest {
  const { light, depth, camera } = CASES.frame;
  const [height, width] = light.shape;
  return { width, height, libraries: [disc], light: unpack(light), depth: unpack(depth), options: { largest: 16 }, camera, ...change };
}

// The solve writes into the integers: without it they stay.
const UNSOLVED = { idle: ["forward", "solve", "back"], read: ["image"] };

/** A picture of one value and depth. */
const flat = (size: number, value: number, depth: number) => ({
  width: size,
  height: size,
  light: new Array(size * size).fill([value, value, value, 1]).flat() as number[],
  depth: new Array(size * size).fill(depth) as number[],
});

describe("against the Python reference", () => {
  it.each(["still", "moving"] as const)("%s pixels: the same integers, and they sum to zero", async (name) => {
    const [charges, primal] = planes(await draw(oneLayer(name, UNSOLVED)), CASES[name]);
    for (const { found, expected } of [charges, primal]) {
      expect(expected.filter((v) => v !== 0).length).toBeGreaterThan(500);
      expect(differing(found, expected)).toBe(0);
    }
    for (let c = 0; c < 4; c++) expect(charges.found.reduce((n, v, i) => n + (i % 4 === c ? v : 0), 0)).toBe(0);
  });

  it.each(["still", "moving"] as const)("%s pixels: the solve agrees to 1e-4 where light is below white", async (name) => {
    const { picture, worst } = await draw(oneLayer(name)).then((a) => ({ ...a, ...compare(a.picture, tidied(unpack(CASES[name].picture))) }));
    const expected = tidied(unpack(CASES[name].picture));
    expect(worst).toBeLessThan(1e-4 * Math.max(1, ...expected));
    expected.forEach((value, i) => value < 1 && expect(Math.abs(picture[i]! - value)).toBeLessThan(1e-4 * 5));
  });

  // The picture of Python is clipped to the same bounds; layers differ where a cut found from a histogram is off by a bin.
  it("two layers, borders extended: above 50 dB of the whole pipeline", async () => {
    const answer = await draw(twoLayers());
    const { psnr } = compare(answer.picture, unpack(CASES.frame.out));
    expect(answer.report.cuts.length).toBe(1);
    expect(psnr).toBeGreaterThan(50);
  });

  it("three layers: above 50 dB of the whole pipeline; a fourth is not there where nothing is left to cut", async () => {
    const answer = await draw(twoLayers({ options: { largest: 16, layers: 3 } }));
    expect(answer.report.cuts.length).toBe(2);
    expect(answer.report.cuts[0]!).toBeLessThan(answer.report.cuts[1]!);
    expect(compare(answer.picture, unpack(CASES.frame.three)).psnr).toBeGreaterThan(50);
    const four = await draw(twoLayers({ options: { largest: 16, layers: 4 } }));
    expect(four.report.cuts).toEqual(answer.report.cuts);
    expect(compare(four.picture, answer.picture).psnr).toBeGreaterThan(100);
  });

  it("a real GPU's larger workgroups give the same", async () => {
    const software = await draw(oneLayer("still"));
    const hardware = await draw(oneLayer("still", { hardware: true }));
    expect(compare(hardware.picture, software.picture).psnr).toBeGreaterThan(100);
  });

  it("one layer, divided by coverage: above 60 dB", async () => {
    const { picture } = await draw(twoLayers({ options: { largest: 16, layers: 1, edges: "renormalise" } }));
    expect(compare(picture, unpack(CASES.frame.one)).psnr).toBeGreaterThan(60);
  });
});

/** Of a list of planted bugs, the first two; all of them in the long tests. */
const planted = <T>(bugs: T[]): T[] => (process.env.LIGHTWELL_LONG_TESTS ? bugs : bugs.slice(0, 2));

describe("planted bugs are found", () => {
  const SPLAT = "splat";
  it.each(planted([
    ["remainders that are not carried", "e = t - (n << b);", "e = vec4i(0);"],
    ["offsets mirrored", "start.x + sign * p.x", "start.x - sign * p.x"],
    ["a mirror that is forgotten", "select(1.0, -1.0, spot.x < 0.0)", "1.0"],
    ["the upper node too late", "fraction > select(0.5,", "fraction > select(0.9,"],
    ["channels swapped", "atomicAdd(&image[at + 1u], n.y)", "atomicAdd(&image[at + 1u], n.z)"],
  ]))("in the scatter: %s", async (_, from, to) => {
    const [{ found, expected }] = planes(await draw(oneLayer("still", { ...UNSOLVED, plant: { shader: SPLAT, from, to } })), CASES.still);
    // A round aperture looks the same mirrored; its stored order does not.
    expect(differing(found, expected)).toBeGreaterThan(from.includes("spot.x < 0.0") ? 50 : 500);
  });

  it.each(planted([
    ["solve", "max((along + circle[k].z)", "max((along + 1.02 * circle[k].z)"],
    ["back", ".yx - level", ".yx"],
    ["forward", "exp2(-16.0)", "exp2(-15.99)"],
  ]))("in the solve: %s", async (shader, from, to) => {
    const { picture } = await draw(oneLayer("still", { plant: { shader, from, to } }));
    expect(compare(picture, tidied(unpack(CASES.still.picture))).psnr).toBeLessThan(60);
  });

  it.each(planted([
    ["behind", "shine += hidden *", "shine += 0.0 * hidden *"],
    ["flood", "far < nearest", "far > nearest"],
    ["composite", "(1.0 - out.w) * behind[at]", "behind[at]"],
    ["splat", "vec3f(cuts.border)", "vec3f(0.1 * cuts.border)"],
    ["choose", "bitcast<i32>(atomicLoad(&stats[EDGES_AT + k]))", "1"],
  ]))("in the layers: %s", async (shader, from, to) => {
    const { picture } = await draw(twoLayers({ plant: { shader, from, to } }));
    expect(compare(picture, unpack(CASES.frame.out)).psnr).toBeLessThan(45);
  });

  it.each(planted([
    ["edges", "min(a, b) < cuts.at[k] && max(a, b) > cuts.at[k]", "false"],
    ["accumulate", "(1.0 - layer.w) * out", "out"],
    ["choose", "cuts.count++;", ""],
  ]))("in three layers: %s", async (shader, from, to) => {
    const { picture } = await draw(twoLayers({ options: { largest: 16, layers: 3 }, plant: { shader, from, to } }));
    expect(compare(picture, unpack(CASES.frame.three)).psnr).toBeLessThan(45);
  });
});

describe("depth", () => {
  const [near, far] = [0.5, 50];
  const perspective = (range: "webgpu" | "webgl", reversed = false) => {
    const m = new Array(16).fill(0) as number[];
    m[11] = -1;
    if (reversed) [m[10], m[14]] = [near / (far - near), (far * near) / (far - near)];
    else if (range === "webgl") [m[10], m[14]] = [-(far + near) / (far - near), (-2 * far * near) / (far - near)];
    else [m[10], m[14]] = [-far / (far - near), (-far * near) / (far - near)];
    return m;
  };
  const buffered = (z: number) => (far / (far - near)) * (1 - near / z);
  const CASES_OF_DEPTH = [
    ["planes", (z: number) => buffered(z), { kind: "planes", near, far }, false],
    ["planes, reversed", (z: number) => 1 - buffered(z), { kind: "planes", near, far, reversed: true }, false],
    ["orthographic planes", (z: number) => (z - near) / (far - near), { kind: "planes", near, far, orthographic: true }, false],
    ["a projection of WebGPU, in a depth buffer", (z: number) => buffered(z), { kind: "projection", matrix: perspective("webgpu") }, true],
    ["a projection of WebGL", (z: number) => buffered(z), { kind: "projection", matrix: perspective("webgl"), range: "webgl" }, false],
    ["a reversed projection", (z: number) => 1 - buffered(z), { kind: "projection", matrix: perspective("webgpu", true) }, true],
    [
      "a reversed projection without end",
      (z: number) => near / z,
      { kind: "projection", matrix: [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, -1, 0, 0, near, 0] },
      true,
    ],
  ] as const;

  const limited = unpack(CASES.frame.depth).map((z) => Math.min(z, far));
  let linear: LensAnswer;
  beforeAll(async () => {
    if (adapter) linear = await draw(twoLayers({ depth: limited, frame: { cut: -3 } }));
  });

  it.each(CASES_OF_DEPTH)("%s", async (_, encode, depthMeaning, depthBuffer) => {
    const answer = await draw(twoLayers({ depth: limited.map(encode), frame: { depthMeaning, cut: -3 }, depthBuffer }));
    expect(compare(answer.picture, linear.picture).psnr).toBeGreaterThan(60);
  });
});

describe("what a picture must be", () => {
  it("a flat picture stays flat", async () => {
    const { picture } = await draw({ ...flat(48, 0.37, 4), libraries: [disc], options: { largest: 16 }, camera: { fstop: 1 } });
    for (const [i, value] of picture.entries()) expect(Math.abs(value - (i % 4 === 3 ? 1 : 0.37))).toBeLessThan(2e-3);
  });

  it("light is kept inside the guard band, to 1e-3", async () => {
    const size = 64;
    const request = flat(size, 0, 1);
    // Coverage stays below 1: what exceeds it would be divided away.
    request.light = request.light.map((v) => 0.3 * v);
    for (let y = 24; y < 40; y++) for (let x = 24; x < 40; x++) request.light.splice(4 * (y * size + x), 3, 1, 0.5, 0.1 + x / 64);
    const camera = unitCamera(size);
    const depth = request.depth.map((_, i) => depthOf(1 + ((i % size) / size) * 10));
    const { picture } = await draw({ ...request, depth, libraries: [disc], options: { layers: 1, edges: "dark", largest: 12 }, camera, frame: { opaque: false } });
    for (let c = 0; c < 3; c++) {
      const sum = (values: number[]) => values.reduce((n, v, i) => n + (i % 4 === c ? v : 0), 0);
      expect(Math.abs(sum(picture) / sum(request.light) - 1)).toBeLessThan(1e-3);
    }
  });

  it("the foreground spills over a sharp background by the closed form; a sharp foreground does not bleed", async () => {
    const [size, r] = [96, 12];
    const camera = unitCamera(size);
    const spill = flat(size, 0, 0);
    const halves = (left: number, right: number) => spill.depth.map((_, i) => depthOf(i % size < size / 2 ? left : right));
    spill.light = spill.light.map((v, i) => (i % 4 === 0 ? Number((i >> 2) % size < size / 2) : i % 4 === 1 ? Number((i >> 2) % size >= size / 2) : v));
    const row = (picture: number[], c: number) => Array.from({ length: size }, (_, x) => picture[4 * (48 * size + x) + c]!);
    const blurred = row((await draw({ ...spill, depth: halves(-r, 0), libraries: [disc], options: { largest: 16 }, camera })).picture, 0);
    blurred.forEach((value, x) => {
      const d = Math.min(1, Math.max(-1, (x + 0.5 - size / 2) / r));
      expect(Math.abs(value - (Math.acos(d) - d * Math.sqrt(1 - d * d)) / Math.PI)).toBeLessThan(0.015);
    });
    const sharp = row((await draw({ ...spill, depth: halves(0, r), libraries: [disc], options: { largest: 16 }, camera })).picture, 1);
    expect(Math.max(...sharp.slice(0, size / 2 - 1))).toBeLessThan(1e-3);
  });

  it("what is not finite stays out: counted, and its neighbours do not notice", async () => {
    const request = twoLayers();
    const clean = await draw(request);
    const [light, depth] = [[...request.light], [...request.depth]];
    light[4 * (20 * 80 + 30)] = Number.NaN;
    light[4 * (21 * 80 + 50) + 1] = Infinity;
    depth[33 * 80 + 12] = Number.NaN;
    depth[5 * 80 + 5] = -1;
    const answer = await draw({ ...request, light, depth });
    expect(answer.report.bad).toBe(4);
    expect(answer.picture.every(Number.isFinite)).toBe(true);
    expect(compare(answer.picture, clean.picture).psnr).toBeGreaterThan(35);
  });

  it("cuts ascend, whichever is found first", async () => {
    const size = 48;
    // Many edges between 0 and 8, few between -8 and 0: the cut behind is found first.
    const depth = flat(size, 0.5, 0).depth.map((_, i) => depthOf(i < 6 * size ? -8 : i % 12 < 6 ? 0 : 8));
    const { report } = await draw({ ...flat(size, 0.5, 0), depth, libraries: [disc], options: { largest: 12, layers: 3 }, camera: unitCamera(size) });
    expect(report.cuts.length).toBe(2);
    expect(report.cuts[0]!).toBeLessThan(0);
    expect(report.cuts[1]!).toBeGreaterThan(0);
  });

  it("blur beyond the library is cut, and counted", async () => {
    const size = 24;
    const depth = flat(size, 0.5, 0).depth.map((_, i) => depthOf(i % size < 5 ? -20 : 3));
    const answer = await draw({ ...flat(size, 0.5, 0), depth, libraries: [disc], options: { largest: 6 }, camera: unitCamera(size) });
    expect(answer.report.clamped).toBe(5 * size);
    expect((await draw({ ...flat(size, 0.5, 2.5), libraries: [disc], options: {}, camera: {} })).report.clamped).toBe(0);
  });

  it("pixels at rest and in motion, with a library for each", async () => {
    const size = 64;
    const request = flat(size, 0.2, 0);
    const camera = unitCamera(size);
    for (let y = 28; y < 36; y++) for (let x = 28; x < 36; x++) request.light.splice(4 * (y * size + x), 3, 1, 1, 1);
    const motion = request.depth.flatMap((_, i) => (Math.abs((i % size) - 31.5) < 4 && Math.abs(Math.floor(i / size) - 31.5) < 4 ? [16, 0] : [0, 0]));
    const options = { layers: 1, largest: 8, edges: "dark" } as const;
    const answer = await draw({ ...request, depth: request.depth.map(() => depthOf(0)), motion, libraries: [disc, joint], options, camera });
    const at = (x: number, y: number) => answer.picture[4 * (y * size + x)]!;
    expect(Math.abs(at(32, 32) - 0.5)).toBeLessThan(0.02);
    expect(at(23, 32)).toBeGreaterThan(0.25);
    expect(Math.abs(at(32, 20) - 0.2)).toBeLessThan(5e-3);
    expect(Math.abs(at(23, 32) - at(40, 32))).toBeLessThan(0.02);
  });
});

describe("a guest that cleans up", () => {
  it("destroys every buffer and texture that it made, and says so when it is used again", async () => {
    const { made, left, after } = await page.evaluate((bytes) => window.lensLeftovers(bytes), disc);
    expect(made).toBeGreaterThan(30);
    expect(left).toBe(0);
    expect(after).toContain("disposed");
  });

  it.each([
    [{ camera: { focal: 0 } }, /focal length 0 mm/],
    [{ camera: { focus: 0.01, focal: 0.05 } }, /not beyond the focal length/],
    [{ frame: { white: 0 } }, /white is 0/],
    [{ frame: { depthMeaning: { kind: "planes", near: 2, far: 1 } } }, /near must be above 0 and below far/],
    [{ options: { largest: Number.NaN } }, /largest blur is NaN/],
    [{ options: { layers: 5 } }, /5 layers; use 1 to 4/],
  ] as const)("refuses %j", async (change, message) => {
    await expect(page.evaluate((r) => window.lensDraw(r), twoLayers(change as Partial<LensRequest>))).rejects.toThrow(message);
  });
});
