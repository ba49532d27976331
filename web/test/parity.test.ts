/**
 * The printed shaders against the NumPy evaluator, in a real Chromium: every vector, WebGL2 and WebGPU, weights in the
 * text and in tables. Writes the largest errors to `test-results/parity.json`.
 */

import { mkdirSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect, test } from "vitest";
import {
  evaluate,
  evaluateFrame,
  FRAME_INPUTS,
  printGlsl,
  printWgsl,
  readGraph,
  type StoredBuffer,
  toHalf,
} from "../runtime/src/graph/index.ts";
import { type Job, runWebgl2, runWebgpu } from "./parity-page.ts";
import { loadVectors, row, type Vector, worstError } from "./parity-vectors.ts";
import { launch, Site } from "./support/browser.ts";

/** The contract of `format/FORMAT.md`, relative to max(1, |value|). */
const TOLERANCE = 1e-4;
const RESULTS = fileURLToPath(new URL("../test-results/", import.meta.url));

const VECTORS = loadVectors();
const MODES = ["webgl2 inline", "webgl2 texture", "webgpu inline", "webgpu storage"] as const;
type Mode = (typeof MODES)[number];
const summary: Record<string, { max: number; worst: string; vectors: number; seconds: number }> = {};

const site = new Site();
let browser: Browser;
let page: Page;

beforeAll(async () => {
  await site.open();
  browser = await launch("swiftshader");
  page = await browser.newPage();
  // WebGPU wants a secure context: an empty page of 127.0.0.1 is one.
  await page.goto(site.put("/index.html", "<!doctype html><title>parity</title>"));
});

afterAll(async () => {
  await browser?.close();
  await site.close();
});

const blocksOf = (width: number) => Math.ceil(width / 4);

/** Inputs as vec4 blocks, [blocks][points][4], and the text that reads input number `i` in a shader. */
function packInputs(vector: Vector): { blocks: number; data: number[]; first: number[] } {
  const first: number[] = [];
  const data: number[] = [];
  let blocks = 0;
  for (const [name, width] of vector.graph.inputs) {
    first.push(blocks);
    const rows = Array.from({ length: vector.points }, (_, point) => row(vector.inputs[name]!, point));
    for (let b = 0; b < blocksOf(width); b++) {
      for (const values of rows) data.push(...[0, 1, 2, 3].map((c) => values[4 * b + c] ?? 0));
    }
    blocks += blocksOf(width);
  }
  return { blocks, data, first };
}

const SWIZZLE = ["", ".x", ".xy", ".xyz", ""];

function glslJob(vector: Vector, weights: "inline" | "texture"): Job {
  const printed = printGlsl(vector.graph, { name: "field", weights });
  const { blocks, data, first } = packInputs(vector);
  const fetch = (b: number) => `texelFetch(inputs, ivec2(gl_FragCoord.x, ${b}), 0)`;
  const call = printed.parameters.map(({ width }, i) => {
    const parts = Array.from({ length: blocksOf(width) }, (_, b) => fetch(first[i]! + b));
    return width > 4 ? `vec4[${parts.length}](${parts.join(", ")})` : `${parts[0]}${SWIZZLE[width]}`;
  });
  const outputs = [...vector.graph.outputs.values()].map((id) => blocksOf(vector.graph.widths.get(id)!));
  const single = !printed.type.endsWith("_result");
  const pick = single
    ? [
        `color = vec4(result${", 0.0".repeat(4 - vector.graph.widths.get([...vector.graph.outputs.values()][0]!)!)});`,
      ]
    : outputs.flatMap((count, o) => {
        const before = outputs.slice(0, o).reduce((a, b) => a + b, 0);
        return Array.from(
          { length: count },
          (_, b) => `if (block == ${before + b}) color = result.o${o}[${b}];`,
        );
      });
  const code = `#version 300 es
precision highp float;
precision highp int;
uniform highp sampler2D inputs;
out vec4 color;
${printed.code}
void main() {
  ${printed.type} result = field(${call.join(", ")});
  int block = int(gl_FragCoord.y);
  ${pick.join("\n  ")}
}`;
  const frame = printed.frame && {
    name: printed.frame.name,
    texture: printed.frame.kind === "texture",
    data: frameData(vector),
  };
  const textures = printed.textures.map(({ name, width, height, format, data: numbers }) => ({
    name,
    width,
    height,
    half: format === "rgba16float",
    data: Buffer.from(numbers.buffer).toString("base64"),
  }));
  const outputBlocks = outputs.reduce((a, b) => a + b, 0);
  return {
    name: vector.name,
    code,
    points: vector.points,
    inputs: data,
    inputBlocks: blocks,
    outputBlocks,
    textures,
    weights: null,
    frame,
  };
}

function wgslJob(vector: Vector, weights: "inline" | "storage"): Job {
  const printed = printWgsl(vector.graph, { name: "field", weights, group: 1 });
  const { blocks, data, first } = packInputs(vector);
  const fetch = (b: number) => `inputs[${b}u * ${vector.points}u + point.x]`;
  const call = printed.parameters.map(({ width }, i) => {
    const parts = Array.from({ length: blocksOf(width) }, (_, b) => fetch(first[i]! + b));
    return width > 4 ? `array<vec4f, ${parts.length}>(${parts.join(", ")})` : `${parts[0]}${SWIZZLE[width]}`;
  });
  const widths = [...vector.graph.outputs.values()].map((id) => vector.graph.widths.get(id)!);
  const single = !printed.type.endsWith("_result");
  const values = single
    ? [`vec4f(result${", 0.0".repeat(4 - widths[0]!)})`]
    : widths.flatMap((width, o) => Array.from({ length: blocksOf(width) }, (_, b) => `result.o${o}[${b}]`));
  const code = `@group(0) @binding(0) var<storage, read> inputs: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> outputs: array<vec4f>;
${printed.code}
@compute @workgroup_size(1) fn main(@builtin(global_invocation_id) point: vec3u) {
  let result = field(${call.join(", ")});
  ${values.map((value, b) => `outputs[${b}u * ${vector.points}u + point.x] = ${value};`).join("\n  ")}
}`;
  return {
    name: vector.name,
    code,
    points: vector.points,
    inputs: data,
    inputBlocks: blocks,
    outputBlocks: values.length,
    textures: [],
    weights: printed.weights && [...printed.weights.data],
    frame: printed.frame && { name: "", texture: false, data: frameData(vector) },
  };
}

const frameData = (vector: Vector) => [
  ...evaluateFrame(
    vector.graph,
    Object.fromEntries(FRAME_INPUTS.flatMap((name) => (vector.inputs[name] ? [[name, row(vector.inputs[name], 0)]] : []))),
  ),
];

/** Largest error of a result over all outputs. */
function errorOf(vector: Vector, values: readonly number[]): number {
  let block = 0;
  let worst = 0;
  for (const [name, id] of vector.graph.outputs) {
    const width = vector.graph.widths.get(id)!;
    for (let point = 0; point < vector.points; point++) {
      const found = Array.from(
        { length: width },
        (_, c) => values[4 * ((block + (c >> 2)) * vector.points + point) + (c & 3)] ?? Number.NaN,
      );
      worst = Math.max(worst, worstError(found, row(vector.outputs[name]!, point)));
    }
    block += blocksOf(width);
  }
  return worst;
}

/** Run vectors in one mode; errors by name. Null when there is no WebGPU. */
async function run(mode: Mode, vectors: Vector[]): Promise<Map<string, number> | null> {
  const [api, weights] = mode.split(" ") as ["webgl2" | "webgpu", never];
  const jobs = vectors.map((vector) => (api === "webgl2" ? glslJob : wgslJob)(vector, weights));
  const results =
    api === "webgl2" ? await page.evaluate(runWebgl2, jobs) : await page.evaluate(runWebgpu, jobs);
  if (!results) return null;
  const errors = new Map<string, number>();
  for (const [i, { name, values, error }] of results.entries()) {
    if (error) throw new Error(`${mode}, ${name}: ${error}\n${jobs[i]!.code}`);
    errors.set(name, errorOf(vectors[i]!, values));
  }
  return errors;
}

test.each(MODES)("%s agrees with NumPy on every vector", async (mode) => {
  const start = performance.now();
  const errors = await run(mode, VECTORS);
  if (!errors) {
    expect(
      process.env.LIGHTWELL_NO_WEBGPU,
      "WebGPU has no adapter; set LIGHTWELL_NO_WEBGPU=1 to do without",
    ).toBe("1");
    return;
  }
  const [worst, max] = [...errors].reduce((a, b) => (b[1] > a[1] ? b : a));
  const seconds = (performance.now() - start) / 1000;
  summary[mode] = { max, worst, vectors: errors.size, seconds: Math.round(seconds * 10) / 10 };
  mkdirSync(RESULTS, { recursive: true });
  writeFileSync(`${RESULTS}.gitignore`, "*\n");
  writeFileSync(
    `${RESULTS}parity.json`,
    JSON.stringify({ browser: browser.version(), tolerance: TOLERANCE, modes: summary }, null, 1),
  );
  const failed = [...errors].filter(([, error]) => !(error <= TOLERANCE));
  expect(Object.fromEntries(failed)).toEqual({});
});

test.each(MODES)("%s catches a transposed layer", async (mode) => {
  const vector = VECTORS.find(({ name }) => name === "network_encoded")!;
  const buffers = new Map(vector.buffers);
  for (const [name, buffer] of buffers)
    if (buffer.shape.join() === "64,64") buffers.set(name, transposed(buffer));
  const errors = await run(mode, [{ ...vector, buffers, graph: readGraph(vector.json, buffers) }]);
  if (errors) expect(errors.get(vector.name)).toBeGreaterThan(100 * TOLERANCE);
});

/** Widths of the network of the 2013 report: 503 weights an expert. */
const REPORT = [12, 20, 10, 3] as const;

test.each(process.env.LIGHTWELL_LONG_TESTS ? [""] : [])("8192 experts of 503 weights fit one texture and each is found", async () => {
  const vector = manyExperts(8192);
  const { textures, code } = printGlsl(vector.graph, { name: "field", weights: "texture" });
  expect(textures.map(({ format, width, height }) => [format, width, height <= 1024])).toEqual([
    ["rgba16float", 2048, true],
  ]);
  // Loops over texels whatever the number of experts: the text must not grow with it.
  const few = printGlsl(manyExperts(2).graph, { name: "field", weights: "texture" }).code;
  expect(code.length).toBeLessThan(few.length + 100);
  const errors = await run("webgl2 texture", [vector]);
  expect(errors!.get(vector.name)).toBeLessThanOrEqual(TOLERANCE);
});

function repeated(values: Uint16Array<ArrayBuffer>, count: number): Uint16Array<ArrayBuffer> {
  const data = new Uint16Array(count);
  for (let at = 0; at < count; at += values.length) data.set(values.subarray(0, count - at), at);
  return data;
}

/** Networks of the report's size with an index input; the truth is the evaluator on the CPU. */
function manyExperts(experts: number): Vector {
  const points = 64;
  const buffers = new Map<string, StoredBuffer>();
  const nodes: Record<string, unknown>[] = [];
  const noise = (i: number) => Math.sin(12.9898 * i + 1) * 43758.5453;
  const random = (i: number) => noise(i) - Math.floor(noise(i)) - 0.5;
  // Weights repeat after a prime, so that each expert has others; to make and round millions of numbers took longest.
  const halves = Uint16Array.from({ length: 4093 }, (_, i) => toHalf(random(i)));
  for (const [i, width] of REPORT.slice(1).entries()) {
    const inputs = REPORT[i]!;
    const store = (name: string, shape: number[]) =>
      buffers.set(name, {
        shape,
        type: "float16",
        data: repeated(halves, shape.reduce((a, b) => a * b)),
      });
    store(`w${i}`, [experts, width, inputs]);
    store(`b${i}`, [experts, width]);
    nodes.push(
      { id: `l${i}`, op: "linear", inputs: [i ? `a${i - 1}` : "a", "index"], weights: `w${i}`, bias: `b${i}` },
      { id: `a${i}`, op: "activate", inputs: [`l${i}`], function: "tanh" },
    );
  }
  const json = {
    version: 1,
    inputs: { a: 12, index: 1 },
    buffers: Object.fromEntries([...buffers].map(([name, { shape, type }]) => [name, { shape: [...shape], type }])),
    nodes,
    outputs: { value: "a2" },
  };
  const graph = readGraph(json, buffers);
  const a = Array.from({ length: 12 * points }, (_, i) => random(i));
  const index = Array.from({ length: points }, (_, i) => Math.round((i * (experts - 1)) / (points - 1)));
  const outputs = index.flatMap((e, i) => [
    ...evaluate(graph, { a: a.slice(12 * i, 12 * (i + 1)), index: [e] }).value!,
  ]);
  return {
    name: `experts_${experts}`,
    json,
    buffers,
    graph,
    points,
    inputs: { a: { shape: [points, 12], data: a }, index: { shape: [points, 1], data: index } },
    outputs: { value: { shape: [points, 3], data: outputs } },
  };
}

function transposed(buffer: StoredBuffer): StoredBuffer {
  const [rows, columns] = buffer.shape as [number, number];
  const data = Float32Array.from(
    buffer.data,
    (_, i) => buffer.data[(i % rows) * columns + Math.floor(i / rows)]!,
  );
  return { ...buffer, data };
}
