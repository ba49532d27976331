/** The graph reader and the CPU evaluator, without a browser. */

import { describe, expect, test } from "vitest";
import {
  evaluate,
  evaluateFrame,
  fromHalf,
  only,
  OPS,
  printGlsl,
  printWgsl,
  readGraph,
  toHalf,
} from "../runtime/src/graph/index.ts";
import { COMMON_OPS } from "../runtime/src/graph/ops/common.ts";
import { opsFor } from "../runtime/src/graph/ops/on-demand.ts";
import type { StoredBuffer } from "../runtime/src/graph/stored.ts";
import { loadVectors, row, worstError } from "./parity-vectors.ts";

const VECTORS = loadVectors();
const TOLERANCE = 1e-4;
const factored = VECTORS.find((vector) => vector.name === "network_factored")!;

test("every op has a vector", () => {
  const seen = new Set(VECTORS.flatMap((vector) => vector.graph.nodes.map((node) => node.opName)));
  expect([...seen].sort()).toEqual(Object.keys(OPS).sort());
});

test("every op is there at once or on demand, and an unknown name brings all of them", async () => {
  expect(Object.keys(await opsFor(["no such op"])).sort()).toEqual(Object.keys(OPS).sort());
  expect(Object.keys(await opsFor(["linear", "tree"])).filter((name) => !Object.hasOwn(COMMON_OPS, name))).toEqual(["tree"]);
  for (const name of Object.keys(OPS)) expect((await opsFor([name]))[name]).toBe(OPS[name]);
});

test.each(VECTORS)("CPU evaluation of $name", ({ graph, points, inputs, outputs }) => {
  for (let point = 0; point < points; point++) {
    const given = Object.fromEntries(
      Object.entries(inputs).map(([name, tensor]) => [name, row(tensor, point)]),
    );
    for (const [name, found] of Object.entries(evaluate(graph, given))) {
      expect(worstError(found, row(outputs[name]!, point))).toBeLessThan(TOLERANCE);
    }
  }
});

test("half floats round trip and round to nearest even", () => {
  const wrong = [];
  for (let bits = 0; bits < 0x7c00; bits++) {
    if (toHalf(fromHalf(bits)) !== bits || toHalf(-fromHalf(bits)) !== (bits | 0x8000)) wrong.push(bits);
  }
  expect(wrong).toEqual([]);
  expect(toHalf(1 + 2 ** -11)).toBe(toHalf(1));
  expect(toHalf(1 + 3 * 2 ** -11)).toBe(toHalf(1 + 2 ** -9));
  expect(toHalf(65520)).toBe(0x7c00);
});

describe("costs and layout", () => {
  test("of a factored field", () => {
    expect(factored.graph.macs).toBe(13 * 16 + 16 * 3);
    expect(factored.graph.macsPerFrame).toBe(18 * 16 + 16 * 12);
    expect(factored.graph.fetches).toBe(8 + 16);
  });

  test("per-frame values fill whole blocks", () => {
    const light = row(factored.inputs.light!, 0);
    const { frame } = printGlsl(factored.graph, { name: "f", weights: "inline" });
    expect(frame).toMatchObject({ name: "f_frame", kind: "array", blocks: 3 });
    expect(evaluateFrame(factored.graph, { light })).toHaveLength(12);
  });

  test("many per-frame values travel in a texture", () => {
    const { graph } = VECTORS.find((vector) => vector.name === "network_wide_frame")!;
    expect(printGlsl(graph, { name: "f", weights: "inline" }).frame).toMatchObject({
      kind: "texture",
      blocks: 144,
    });
  });

  test("float16 networks travel as half floats", () => {
    const { graph } = VECTORS.find((vector) => vector.name === "network_encoded_float16")!;
    const { textures } = printGlsl(graph, { name: "f", weights: "texture" });
    expect(textures.map((texture) => texture.format)).toEqual(["rgba16float"]);
    expect(printGlsl(graph, { name: "f", weights: "inline" }).textures).toEqual([]);
  });

  test("looped text does not grow with the width of the network", () => {
    const { graph } = VECTORS.find((vector) => vector.name === "network_encoded")!;
    expect(printGlsl(graph, { name: "f", weights: "texture" }).code.length).toBeLessThan(12_000);
    expect(printWgsl(graph, { name: "f", weights: "storage" }).code.length).toBeLessThan(12_000);
  });
});

test("an output costs only what it needs", () => {
  const { graph } = VECTORS.find((vector) => vector.name === "network_segments")!;
  const ops = (...names: string[]) => only(graph, ...names).nodes.map((node) => node.opName);
  expect(ops("segment")).not.toContain("tree");
  expect(ops("radiance")).toContain("tree");
  expect(only(graph, "overlap", "segment").macs).toBe(3 * 16 + 16 * 5);
  expect([...only(graph, "segment", "nothing").outputs.keys()]).toEqual(["segment"]);
  const { code } = printGlsl(only(graph, "segment"), { name: "f", weights: "texture" });
  expect(code).not.toContain("tree");
  expect([...only(graph, "segment").inputs.keys()]).toEqual(["position"]);
});

test("two layers that share their weights store them once", () => {
  const { graph } = VECTORS.find((vector) => vector.name === "network_segments")!;
  const texels = (names: string[]) =>
    printGlsl(only(graph, ...names), { name: "f", weights: "inline" }).textures.reduce(
      (sum, { data }) => sum + data.length,
      0,
    );
  // 5 experts of 1 block of outputs, 1 + 16 texels each; 40 rows; the tree's nodes.
  const nodes = graph.nodes.find((node) => node.opName === "tree")!.use.buffer.nodes!.shape[0]!;
  expect(texels(["radiance"])).toBeLessThan(4 * 2 * (5 * 17 + 40 + nodes));
  expect(texels(["radiance"])).toBeGreaterThanOrEqual(4 * (5 * 17 + 40 + nodes));
});

test.each(["inline", "texture"] as const)("wide rows, such as those of probes, are neither read nor added up by loops (%s)", (weights) => {
  const json = {
    version: 1,
    inputs: { at: 1, more: 1 },
    buffers: { light: { shape: [3, 216], type: "float32" } },
    nodes: [
      { id: "near", op: "rows", inputs: ["at"], buffer: "light" },
      { id: "far", op: "rows", inputs: ["more"], buffer: "light" },
      { id: "part", op: "multiply", inputs: ["more", "far"] },
      { id: "sum", op: "add", inputs: ["near", "part"] },
    ],
    outputs: { sum: "sum" },
  };
  const graph = readGraph(json, new Map([["light", { shape: [3, 216], type: "float32", data: new Float32Array(648) }]]));
  const { code } = printGlsl(graph, { name: "f", weights });
  // llvmpipe compiled a page with probes for more than 110 s where loops wrote these arrays, and for 9 s without.
  expect(code).not.toContain("for (");
  expect(code.match(/texelFetch|f_full\(/g)!.length).toBeGreaterThan(2 * 54);
});

type Document = Record<string, unknown> & { nodes: Record<string, unknown>[] };

describe("hostile graphs are refused by name", () => {
  const change: [string, (document: Document) => void, RegExp][] = [
    ["unknown version", (d) => Object.assign(d, { version: 2 }), /graph.version: expected 1/],
    ["unknown key", (d) => Object.assign(d, { extra: 1 }), /graph.extra: expected nothing of that name/],
    ["unknown op", (d) => Object.assign(d.nodes[0]!, { op: "toString" }), /nodes\[0\].op: expected one of/],
    ["unknown parameter", (d) => Object.assign(d.nodes[0]!, { x: 1 }), /nodes\[0\].x: expected nothing/],
    ["code in an id", (d) => Object.assign(d.nodes[0]!, { id: "a;}" }), /nodes\[0\].id: expected a name/],
    ["forward reference", (d) => d.nodes.reverse(), /expected graph inputs or earlier nodes/],
    [
      "infinite number",
      (d) => Object.assign(d.nodes[0]!, { scale: [1, 2, Infinity] }),
      /a finite number|a number in/,
    ],
    ["wrong length", (d) => Object.assign(d.nodes[0]!, { scale: [1] }), /expected 3 numbers/],
    [
      "missing output",
      (d) => Object.assign(d, { outputs: { radiance: "none" } }),
      /outputs.radiance: expected the name/,
    ],
    [
      "wide input",
      (d) => Object.assign(d, { inputs: { ...(d.inputs as object), position: 1e9 } }),
      /inputs.position/,
    ],
    [
      "per-frame node on a pixel's input",
      (d) => Object.assign(d.nodes[0]!, { inputs: ["position"] }),
      /frame inputs only/,
    ],
    ["prototype as input", (d) => Object.assign(d.nodes[0]!, { inputs: ["__proto__"] }), /earlier nodes/],
    ["no nodes", (d) => Object.assign(d, { nodes: [] }), /at least one node/],
    ["nodes of another kind", (d) => Object.assign(d, { nodes: "abc" }), /graph.nodes: expected an array/],
  ];
  test.each(change)("%s", (_name, mutate, message) => {
    const document = structuredClone(factored.json) as unknown as Document;
    mutate(document);
    expect(() => readGraph(document, factored.buffers)).toThrow(message);
  });

  const TREES: [string, number[], RegExp][] = [
    ["half an axis", [0.5, 0, -1, -2], /an axis from 0 to 1 in row 0/],
    ["an axis beyond the input", [2, 0, -1, -2], /an axis from 0 to 1 in row 0/],
    ["half a child", [0, 0, -1.5, -2], /children of row 0/],
    ["a root that is its own child", [0, 0, 0, -2], /children of row 0/],
    ["a way back", [0, 0, 1, -2, 0, 0, 0, -1], /children of row 1/],
    ["a child beyond the rows", [0, 0, 1, -2], /children of row 0 that are leaves or rows after it, below 1/],
    ["a leaf number that floats cannot count to", [0, 0, -1, -3e7], /children of row 0/],
    ["more levels than its depth", [0, 0, 1, -1, 0, 0, 2, -1, 1, 0, -1, -2], /a tree of at most 2 levels/],
  ];
  const treeOf = (nodes: number[], type: "float32" | "float16" = "float32") => {
    const shape = [nodes.length / 4, 4];
    const data = type === "float32" ? Float32Array.from(nodes) : Uint16Array.from(nodes, toHalf);
    const json = {
      version: 1,
      inputs: { a: 2 },
      buffers: { nodes: { shape, type } },
      nodes: [{ id: "leaf", op: "tree", inputs: ["a"], nodes: "nodes", depth: 2 }],
      outputs: { leaf: "leaf" },
    };
    return readGraph(json, new Map([["nodes", { shape, type, data }]]));
  };
  test.each(TREES)("a tree with %s", (_name, nodes, message) => {
    expect(() => treeOf(nodes)).toThrow(message);
  });
  test("a tree of rounded nodes", () => {
    expect(() => treeOf([0, 0, -1, -2], "float16")).toThrow(/nodes of type float32/);
    expect(evaluate(treeOf([0, 0.5, 1, -2, 1, 0.25, -1, -3]), { a: [0.4, 0.3] }).leaf).toEqual(
      Float32Array.of(2),
    );
  });

  test.each([["no scale", {}], ["an empty list of scales", { scale: [] }]])("bytes with %s", (_name, quantisation) => {
    const json = {
      version: 1,
      inputs: { a: 1 },
      buffers: { w: { shape: [2, 1], type: "float32" }, b: { shape: [2], type: "int8" } },
      nodes: [{ id: "y", op: "linear", inputs: ["a"], weights: "w", bias: "b" }],
      outputs: { y: "y" },
    };
    const read = (given: object) =>
      readGraph(json, new Map<string, StoredBuffer>([
        ["w", { shape: [2, 1], type: "float32", data: new Float32Array(2) }],
        ["b", { shape: [2], type: "int8", data: Int8Array.of(1, 2), ...given }],
      ]));
    expect(evaluate(read({ scale: 0.5 }), { a: [0] }).y).toEqual(Float32Array.of(0.5, 1));
    expect(() => read(quantisation)).toThrow(/b\.scale: expected one number, or one per index/);
  });

  test("buffers of the wrong size, with NaN, missing, unused", () => {
    const [name, buffer] = [...factored.buffers].find(([, b]) => b.type === "float32")!;
    const read = (changed: Map<string, typeof buffer>) => () => readGraph(factored.json, changed);
    const replaced = (changed: Partial<typeof buffer>) =>
      new Map(factored.buffers).set(name, { ...buffer, ...changed });
    expect(read(replaced({ data: new Float32Array(1) }))).toThrow(/expected \d+ numbers, found 1/);
    expect(read(replaced({ data: Float32Array.from(buffer.data).fill(NaN) }))).toThrow(/finite numbers/);
    expect(read(replaced({ shape: [2 ** 20, 2 ** 20] }))).toThrow(/at most/);
    expect(read(replaced({ scale: 2 }))).toThrow(/no scale or offset on a float type/);
    expect(read(new Map())).toThrow(/its numbers beside the graph/);
    const document = structuredClone(factored.json);
    document.buffers.extra = { shape: [1], type: "float32" };
    const extra = new Map(factored.buffers).set("extra", {
      shape: [1],
      type: "float32",
      data: new Float32Array(1),
    });
    expect(() => readGraph(document, extra)).toThrow(/extra: expected a buffer that some node uses/);
  });
});
