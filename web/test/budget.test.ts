/** Graphs that ask for too much are refused before anything is printed, in a hurry and with a cure. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { checkContainer, FormatError, readContainer, readExtension } from "lightwell";
import { BUDGET, budgetOf, printGlsl, printWgsl, readGraph } from "lightwell/graph";
import { afterEach, describe, expect, it, vi } from "vitest";
import { wideSums } from "../fuzz/bombs.ts";
import { pictureSize } from "../runtime/src/picture-size.ts";
import { loadVectors } from "./parity-vectors.ts";
import { keepFigure } from "./support/figures.ts";
import { plainRoom } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";

type Json = any;

const SHARED = fileURLToPath(new URL("../../format/budget.json", import.meta.url));
const NOTHING = new Map();

/** A room whose field was changed. */
const room = (tamper: (json: Json) => void): Json => readContainer(writeGlb(plainRoom({ tamper }))).json;
/** A document that holds graphs alone. */
const read = (graphs: Json[], budget = BUDGET) =>
  readExtension(
    { extensions: { LIGHTWELL_neural_radiance: { version: 1, fields: graphs.map((graph) => ({ role: "static", graph })) } } },
    { bufferView: async () => new ArrayBuffer(0), texture: async () => ({ source: null, width: 1, height: 1 }) },
    budget,
  );
const graphOf = (nodes: Json[], radiance: string) => ({ version: 1, inputs: { position: 3 }, buffers: {}, nodes, outputs: { radiance } });

/** `count` encodings, all of which the sum at the end needs, and a sum of them in three components. */
function held(count: number): Json {
  const nodes: Json[] = Array.from({ length: count }, (_, i) => ({ id: `k${i}`, op: "frequency", inputs: ["position"], octaves: 24 }));
  nodes.push({ id: "all", op: "concat", inputs: nodes.map(({ id }) => id) }, { id: "y", op: "slice", inputs: ["all"], start: 0, width: 3 });
  return graphOf(nodes, "y");
}

it("the numbers are those of format/budget.json", () => {
  const { work, work_per_frame: workPerFrame, live, text } = JSON.parse(readFileSync(SHARED, "utf8"));
  expect({ work, workPerFrame, live, text }).toEqual(BUDGET);
});

it("every vector of the tests is within the budget, and work counts at least its multiply-adds", () => {
  for (const { graph } of loadVectors()) {
    expect(graph.work).toBeLessThanOrEqual(BUDGET.work);
    expect(graph.work).toBeGreaterThanOrEqual(graph.macs);
  }
});

describe("104 kB of JSON that would be 82 MB of GLSL", () => {
  const hostile = room((json) => wideSums(json, 2003));
  const { graph } = hostile.extensions.LIGHTWELL_neural_radiance.fields[0];

  it("is refused within 100 ms, with place and cure", async () => {
    expect(JSON.stringify(graph).length).toBeGreaterThan(100_000);
    const times: number[] = [];
    for (let i = 0; i < 5; i++) {
      const start = performance.now();
      checkContainer(hostile);
      await expect(read([graph])).rejects.toThrow(/graph\.nodes\[\d+\] \('n\d+'\): expected at most 100000 operations per pixel.*raise the budget's `work`/);
      times.push(performance.now() - start);
    }
    keepFigure("hostile graph, ms", Math.min(...times));
    expect(Math.min(...times)).toBeLessThan(100);
  });

  it("is refused by the printers too, where the budget was raised", () => {
    const budget = budgetOf({ work: Infinity, live: Infinity });
    const valid = readGraph(graph, NOTHING, budget);
    for (const print of [
      () => printGlsl(valid, { name: "f", weights: "inline" }),
      () => printWgsl(valid, { name: "f", weights: "inline" }),
    ]) {
      const start = performance.now();
      expect(print).toThrow(FormatError);
      expect(print).toThrow(/f: expected a shader of at most 1000000 characters/);
      expect(performance.now() - start).toBeLessThan(2_000);
    }
  });
});

describe("budget", () => {
  const sines = (count: number) =>
    graphOf(Array.from({ length: count }, (_, i) => ({ id: `n${i}`, op: "activate", inputs: [i ? `n${i - 1}` : "position"], function: "sine" })), `n${count - 1}`);

  it("counts the fields of a file together", async () => {
    const graphs = Array.from({ length: 3 }, () => sines(1000));
    await expect(read(graphs, budgetOf({ work: 9_000 }))).resolves.toMatchObject({ fields: [{}, {}, {}] });
    await expect(read(graphs, budgetOf({ work: 8_999 }))).rejects.toThrow(/fields\[2\]: expected at most 8999 operations per pixel in all fields/);
  });

  it("counts numbers that are needed at the same time", () => {
    expect(() => readGraph(held(6), NOTHING)).not.toThrow();
    expect(() => readGraph(held(14), NOTHING)).toThrow(/graph\.nodes \('all'\): expected at most 2048 numbers needed at a time/);
    expect(() => readGraph(held(14), NOTHING, budgetOf({ live: 1 << 14 }))).not.toThrow();
  });

  it("counts multiply-adds, table reads and what is evaluated once a frame", () => {
    const stored = (shape: number[]) => ({ shape, type: "float32" as const, data: new Float32Array(shape.reduce((a, b) => a * b)) });
    const layer = (perFrame: boolean) => ({
      version: 1,
      inputs: { [perFrame ? "light" : "position"]: 3 },
      buffers: { w: { shape: [500, 3], type: "float32" }, b: { shape: [500], type: "float32" } },
      nodes: [{ id: "y", op: "linear", inputs: [perFrame ? "light" : "position"], weights: "w", bias: "b", per_frame: perFrame }],
      outputs: { radiance: "y" },
    });
    const buffers = new Map([["w", stored([500, 3])], ["b", stored([500])]]);
    expect(readGraph(layer(false), buffers).work).toBe(1500 + 500);
    expect(() => readGraph(layer(true), buffers, budgetOf({ workPerFrame: 1_999 }))).toThrow(/1999 operations per frame/);
    const grid = graphOf([{ id: "y", op: "grid", inputs: ["position"], buffer: "g" }], "y");
    const found = readGraph({ ...grid, buffers: { g: { shape: [2, 2, 2, 5], type: "float32" } } }, new Map([["g", stored([2, 2, 2, 5])]]));
    expect(found.work).toBe(8 * 5 + 5);
  });

  it("stops tables that no texture holds before they are padded", () => {
    const shapes = { w: [2 ** 22, 1, 1], b: [2 ** 22, 1] };
    const buffers = new Map(Object.entries(shapes).map(([key, shape]) => [key, { shape, type: "int8" as const, scale: 1, data: new Int8Array(2 ** 22) }]));
    const nodes = [
      { id: "x", op: "slice", inputs: ["position"], start: 0, width: 1 },
      { id: "y", op: "linear", inputs: ["x", "x"], weights: "w", bias: "b" },
    ];
    const declared = Object.fromEntries(Object.entries(shapes).map(([key, shape]) => [key, { shape, type: "int8", scale: 1 }]));
    const graph = readGraph({ ...graphOf(nodes, "y"), buffers: declared }, buffers);
    expect(() => printGlsl(graph, { name: "f", weights: "inline" })).toThrow(/f: expected at most 4194304 texels of weights/);
  });
});

describe("light that is no number", () => {
  afterEach(() => void vi.restoreAllMocks());

  it("is said on the console", async () => {
    const warn = vi.spyOn(console, "warn").mockImplementation(() => {});
    const overflow = [
      { id: "a", op: "affine", inputs: ["position"], scale: [0, 0, 0], offset: [3e38, 3e38, 3e38] },
      { id: "y", op: "scale", inputs: ["a"], factor: 2 },
    ];
    await read([graphOf(overflow, "y")]);
    expect(warn).toHaveBeenCalledExactlyOnceWith(expect.stringMatching(/fields\[0\]: expected finite radiance at the origin, found Infinity/));
    await read([graphOf(overflow.slice(0, 1), "a")]);
    expect(warn).toHaveBeenCalledOnce();
  });
});

describe("checkContainer refuses", () => {
  const cases: [string, (json: Json) => void, RegExp][] = [
    ["a view past its buffer", (json) => void (json.bufferViews[1].byteLength = 1e6), /bufferViews\[1\]: expected bytes inside of its buffer/],
    ["a buffer past the binary chunk", (json) => void (json.buffers[0].byteLength += 8), /buffers\[0\]\.byteLength: expected at most the \d+ bytes/],
    ["an accessor past its view", (json) => void (json.accessors[1].count += 1), /accessors\[1\]: expected \d+ bytes, found \d+ in bufferViews\[1\]/],
    ["an index into a table that is not there", (json) => void (json.materials[0].emissiveTexture = { index: 0 }), /emissiveTexture\.index: expected no index: the document has no textures/],
    ["a place of another type", (json) => void (json.nodes[0].translation = "here"), /nodes\[0\]\.translation: expected an array/],
    ["a name that is no text", (json) => void (json.nodes[0].name = 5), /nodes\[0\]\.name: expected a string/],
    ["positions of two components", (json) => void (json.accessors[0].type = "VEC2"), /meshes\[0\]\.primitives\[0\]\.POSITION: expected an accessor of type VEC3/],
    ["emission beyond all use", (json) => void (json.materials[0].emissiveFactor = [1e29, 0, 0]), /emissiveFactor\[0\]: expected a number in \[0, 1000000000000\]/],
    ["zeros that fill the memory", (json) => void (json.accessors[0] = { componentType: 5126, type: "VEC3", count: 1e7 }), /accessors\[0\]: expected a bufferView, or at most 67108864 bytes of zeros/],
    ["400 instances of 30 M indices", (json) => {
      json.bufferViews.push({ buffer: 0, byteLength: 6e7 });
      json.buffers[0] = { byteLength: 1e8, uri: "data:,x" };
      json.accessors[2] = { bufferView: json.bufferViews.length - 1, componentType: 5123, type: "SCALAR", count: 3e7 };
      json.nodes = Array.from({ length: 400 }, () => ({ mesh: 0 }));
      json.scenes[0].nodes = [0];
    }, /nodes\[3\]: expected at most 96000000 indices drawn/],
    ["a tree too deep to walk", (json) => {
      json.nodes = Array.from({ length: 5000 }, (_, i) => (i < 4999 ? { children: [i + 1] } : {}));
      json.scenes[0].nodes = [0];
    }, /nodes\[4000\]: expected a tree of at most 4000 levels/],
    ["a picture of 60,000 × 60,000", (json) => void (json.images = [{ uri: "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAA6mAAAOpgCAIAAAA=" }]), /images\[0\]: expected at most 16384 × 8192 texels, found 60000 × 60000/],
    ["a decompression bomb", (json) => {
      const packed = { buffer: 0, byteLength: 16, byteStride: 4, count: 2 ** 27, mode: "ATTRIBUTES" };
      json.bufferViews[0] = { buffer: 0, byteLength: 16, extensions: { EXT_meshopt_compression: packed } };
    }, /EXT_meshopt_compression: expected a count that fits into 16 bytes/],
  ];
  it.each(cases)("%s", (_name, tamper, message) => {
    const { json, binary } = readContainer(writeGlb(plainRoom({ tamper })));
    expect(() => checkContainer(json, binary)).toThrow(FormatError);
    expect(() => checkContainer(json, binary)).toThrow(message);
  });
});

it("sizes of pictures are read from their heads", () => {
  const bytes = (hex: string) => Uint8Array.from(hex.match(/../g)!, (pair) => Number.parseInt(pair, 16));
  const [riff, webp] = ["524946460000000057454250565038", "0000000000000000"];
  expect(pictureSize(bytes("89504e470d0a1a0a0000000d494844520000012c000000c8"))).toEqual({ width: 300, height: 200 });
  expect(pictureSize(bytes("ffd8ffe000040000ffc0001108006401c2"))).toEqual({ width: 450, height: 100 });
  expect(pictureSize(bytes(`${riff}58${webp}2b0100c70000`))).toEqual({ width: 300, height: 200 });
  expect(pictureSize(bytes(`${riff}4c000000002f2bc13100`))).toEqual({ width: 300, height: 200 });
  expect(pictureSize(bytes(`${riff}20000000000000009d012a2c01c800`))).toEqual({ width: 300, height: 200 });
  expect(pictureSize(bytes("ffd8ff"))).toBeNull();
  expect(pictureSize(new Uint8Array(0))).toBeNull();
});
