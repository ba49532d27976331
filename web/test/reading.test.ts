/** Parts of the runtime that need no browser. */

import { Arc, checkContainer, FormatError, LightwellLoaderPlugin, parseLearned, readExtension } from "lightwell";
import { Vector3 } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { describe, expect, it, vi } from "vitest";
import { compare } from "../viewer/src/comparison.ts";
import { readOptions } from "../viewer/src/options.ts";
import { readPageData } from "../viewer/src/page-data.ts";
import { plainRoom } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";

describe("Arc", () => {
  it("passes through its three directions", () => {
    const arc = new Arc([1, 0, 0], [0, 1, 0], [-1, 0, 0]);
    for (const [t, x, y] of [
      [0, 1, 0],
      [0.25, Math.SQRT1_2, Math.SQRT1_2],
      [0.5, 0, 1],
      [1, -1, 0],
    ] as const) {
      expect(arc.at(t).distanceTo(new Vector3(x, y, 0))).toBeLessThan(1e-6);
    }
    for (const t of [0, 0.2, 0.5, 0.9, 1]) expect(arc.time(arc.at(t))).toBeCloseTo(t, 6);
    expect(arc.time(new Vector3(1, -0.1, 0))).toBe(0);
    expect(arc.time(new Vector3(-1, -0.1, 0))).toBe(1);
  });

  it("goes the long way when its middle lies there", () => {
    const arc = new Arc([1, 0, 0], [-1, 0, 0.001], [0, 0, -1]);
    expect(arc.at(0.5).distanceTo(new Vector3(-1, 0, 0.001).normalize())).toBeLessThan(1e-6);
    expect(arc.at(1).distanceTo(new Vector3(0, 0, -1))).toBeLessThan(1e-6);
  });

  it("stands still where the directions coincide", () => {
    const arc = new Arc([0, 1, 0], [0, 1, 0], [0, 1, 0]);
    expect(arc.at(0.7).distanceTo(new Vector3(0, 1, 0))).toBeLessThan(1e-9);
  });
});

describe("a mesh without positions", () => {
  it("is said on the console", async () => {
    const warn = vi.spyOn(console, "warn").mockImplementation(() => {});
    const file = writeGlb(plainRoom({ tamper: (json) => delete (json as Record<string, any>).meshes[0].primitives[0].attributes.POSITION }));
    await parseLearned(new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser)), file.slice().buffer);
    expect(warn).toHaveBeenCalledWith(expect.stringMatching(/expected positions, found none/));
    warn.mockRestore();
  });
});

describe("a buffer that is a picture", () => {
  const picture = { shape: [4, 8, 3], type: "uint8", scale: 1 / 255, texture: 0 };
  const read = (change: object, decoded = { source: "it", width: 8, height: 4 }) => {
    const graph = {
      version: 1,
      inputs: { uv1: 2 },
      buffers: { f: { ...picture, ...change } },
      nodes: [{ id: "y", op: "texture", inputs: ["uv1"], buffer: "f" }],
      outputs: { radiance: "y" },
    };
    const json = {
      textures: [{}],
      extensions: { LIGHTWELL_neural_radiance: { version: 1, fields: [{ role: "static", graph }] } },
    };
    return readExtension(json, { bufferView: async () => new ArrayBuffer(96), texture: async () => decoded });
  };

  it("keeps what the loader decoded", async () => {
    const found = await read({ mips: 3 });
    expect(found!.fields[0]!.buffers.get("f")!.picture).toEqual({ source: "it", mips: 3, bytes: 0 });
  });

  it.each([
    ["a texture that is not there", { texture: 1 }, /texture: expected a number in \[0, 0\]/],
    ["a texture and an accessor", { accessor: 0 }, /expected one of accessor and texture/],
    ["another shape than the picture's", { shape: [4, 4, 3] }, /expected 4 × 4 texels, found 8 × 4/],
    ["four channels", { shape: [4, 8, 4] }, /expected uint8 \[H, W, 3\]/],
    ["another type", { type: "float16", scale: undefined }, /expected uint8/],
    ["a scale a row", { scale: [1, 1, 1, 1] }, /one scale/],
    ["bytes without a scale", { scale: undefined }, /buffers\.f\.scale: expected a finite number/],
    ["absurd mipmaps", { mips: 99 }, /mips: expected/],
    ["an absurd size", { shape: [8192, 8192, 3] }, /at most 67108864 elements/],
  ])("refuses %s", async (_name, change, message) => {
    await expect(read(change)).rejects.toThrow(message);
  });
});

describe("readExtension", () => {
  const load = { bufferView: async () => new ArrayBuffer(64), texture: async () => ({ source: null, width: 1, height: 1 }) };
  const read = (extension: unknown) =>
    readExtension({ extensions: { LIGHTWELL_neural_radiance: extension } }, load);

  it("is null for other files", async () => {
    expect(await readExtension({}, load)).toBeNull();
  });

  it.each([
    [5, "LIGHTWELL_neural_radiance: expected an object"],
    [{ version: 1, variables: [{ kind: "moon" }] }, 'variables[0].kind: expected "point", "sun" or "environment"'],
    [
      { version: 1, variables: [{ kind: "point", low: [0, 0, Number.NaN] }] },
      "low[2]: expected a finite number",
    ],
    [
      { version: 1, variables: [{ kind: "sun", start: [0, 0, 0], middle: [0, 1, 0], end: [0, 0, 1] }] },
      "not zero",
    ],
  ])("refuses %j", async (extension, message) => {
    await expect(read(extension)).rejects.toThrow(FormatError);
    await expect(read(extension)).rejects.toThrow(message);
  });

  /** `format/FORMAT.md`, *Budget*: less than the schema allows. */
  it.each([
    ["variables", { variables: Array(5).fill({ kind: "sun", start: [1, 1, 0], middle: [0, 1, 0], end: [0, 1, 1], initial: [0, 1, 0] }) }, "variables: expected at most 4 entries, found 5"],
    ["fields", { fields: Array(9).fill({}) }, "fields: expected at most 8 entries, found 9"],
    ["probes", { probes: Array(9).fill({}) }, "probes: expected at most 8 entries, found 9"],
  ])("refuses more %s than a page can show", async (_name, extension, message) => {
    const refused = read({ version: 2, variables: [], fields: [], ...extension });
    await expect(refused).rejects.toThrow(FormatError);
    await expect(refused).rejects.toThrow(`LIGHTWELL_neural_radiance.${message}`);
  });

  it("refuses a scale on a float type", async () => {
    const graph = {
      version: 1,
      inputs: { position: 3 },
      buffers: { w: { shape: [3, 3], type: "float32", accessor: 0, scale: 2 } },
      nodes: [{ id: "y", op: "linear", inputs: ["position"], weights: "w", bias: "w" }],
      outputs: { radiance: "y" },
    };
    const json = {
      accessors: [{ type: "SCALAR", componentType: 5126, count: 9, bufferView: 0 }],
      bufferViews: [{}],
      extensions: { LIGHTWELL_neural_radiance: { version: 1, fields: [{ role: "static", graph }] } },
    };
    await expect(readExtension(json, load)).rejects.toThrow(/buffers\.w: expected no scale or offset on a float type/);
  });
});

it("a node with two parents is no tree", () => {
  expect(() => checkContainer({ asset: { version: "2.0" }, nodes: [{ children: [2] }, { children: [2] }, {}] })).toThrow(
    "another parent",
  );
});

it("a picture equals itself", () => {
  const picture = new Uint16Array([0x3800, 0x3800, 0x3800, 0x3c00, 0x3400, 0x3400, 0x3400, 0x3c00]);
  const upsideDown = new Uint16Array([...picture.slice(4), ...picture.slice(0, 4)]);
  expect(compare(upsideDown, picture, 1, 2)).toEqual({ relativeError: 0, psnr: 120 });
});

it("page data that makes no sense is dropped", () => {
  const page = readPageData({
    links: [{ href: "report.html", text: "report" }, { href: "javascript:alert(1)", text: "no" }, { href: "//example.invalid/a.html", text: "no" }, { href: "a.html" }],
    title: 3,
    exposure: -1,
    home: { position: [0, 0] },
    views: [{}, { camera: 1 }],
    report: { a: "b", psnr_db: 30, seconds: { total: 9 } },
  });
  expect(page).toEqual({
    title: "",
    exposure: null,
    home: null,
    views: [],
    report: { psnr_db: 30, seconds: 9 },
    links: [{ href: "report.html", text: "report" }],
  });
});

it("options that make no sense are absent", () => {
  expect(readOptions("?size=0x9&mode=best&view=-1&tonemap=pop&weights=x")).toMatchObject({
    size: null,
    mode: null,
    view: null,
    toneMapping: null,
    weights: null,
  });
  expect(readOptions("?size=640x360&mode=split&view=2&ui=0")).toMatchObject({
    size: [640, 360],
    mode: "split",
    view: 2,
    ui: false,
  });
});
