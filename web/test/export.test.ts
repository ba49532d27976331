/** Exported shader texts, bound as their headers say, against the NumPy evaluator; in WebGL 2 and in WebGPU. */

import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import type { Browser, Page } from "playwright-core";
import { readExtension } from "lightwell";
import { exportShader } from "lightwell/export";
import { evaluate, type StoredBuffer } from "lightwell/graph";
import { afterAll, beforeAll, describe, expect, it } from "vitest";
import { type ExportedJob, runExportedGlsl, runExportedWgsl, runShadertoy } from "./pages/exported.ts";
import { loadVectors, row, type Vector, worstError } from "./parity-vectors.ts";
import { launch, openPage, Site } from "./support/browser.ts";

type Json = any;
const here = (path: string) => fileURLToPath(new URL(path, import.meta.url));
const FIXTURE = readFileSync(here("fixtures/lightmap.glb"));
const TRUTH = JSON.parse(readFileSync(here("fixtures/lightmap.json"), "utf8")) as {
  inputs: Record<string, number[][]>;
  outputs: { radiance: number[][] };
};
/** format/FORMAT.md asks for this where nothing is sampled in hardware. */
const TOLERANCE = 1e-4;
/** Hardware filters weigh texels with 8 bits or so, of features that reach ±4 and an exponential behind them. */
const SAMPLED_TOLERANCE = 0.02;

let browser: Browser;
let page: Page;
const site = new Site();

beforeAll(async () => {
  await site.open();
  browser = await launch("swiftshader");
  ({ page } = await openPage(browser));
  await page.goto(site.put("/index.html", "<!doctype html><title>export</title>"));
});

afterAll(async () => {
  await browser?.close();
  await site.close();
});

/** The light map fixture: its graph, and its pictures as they are in the file. */
async function fixture() {
  const length = FIXTURE.readUInt32LE(12);
  const json: Json = JSON.parse(FIXTURE.subarray(20, 20 + length).toString());
  const bytes = FIXTURE.subarray(28 + length);
  const view = (index: number) => {
    const { byteOffset = 0, byteLength } = json.bufferViews[index];
    return bytes.subarray(byteOffset, byteOffset + byteLength);
  };
  const texture = async (index: number) => {
    const { source, extensions } = json.textures[index];
    const image = json.images[extensions?.EXT_texture_webp?.source ?? source];
    const [width, height] = image.mimeType === "image/webp" ? [8, 8] : [16, 16];
    return { source: { mime: image.mimeType, base64: view(image.bufferView).toString("base64") }, width, height };
  };
  const bufferView = async (index: number) => new Uint8Array(view(index)).buffer;
  return (await readExtension(json, { bufferView, texture }))!.fields[0]!.graph;
}

const errorOf = (found: number[][], expected: number[][]) =>
  Math.max(...found.map((values, i) => worstError(values, expected[i]!)));

/** A job of an exported text over a vector's inputs. */
function jobOf(shader: ReturnType<typeof exportShader>, inputs: ExportedJob["inputs"]): ExportedJob {
  return {
    text: shader.text,
    name: "lightwell",
    inputs,
    tables: shader.tables.map((table) => ({ ...table, data: [...table.data] })),
    pictures: [...shader.pictures].map(([name, { picture }]) => ({ name, ...(picture!.source as { mime: string; base64: string }) })),
  };
}

const run = (to: "glsl" | "wgsl", job: ExportedJob) =>
  to === "glsl" ? page.evaluate(runExportedGlsl, job) : page.evaluate(runExportedWgsl, job);

/** Vectors of whole networks whose first output can be called a radiance. */
const NETWORKS: Vector[] = loadVectors().filter(
  ({ name, graph }) =>
    name.startsWith("network_") &&
    [...graph.inputs.values()].every((width) => width <= 4) &&
    graph.widths.get([...graph.outputs.values()][0]!) === 3,
);

/** Where the weights of a network stand: both places in the long tests, each for half of the networks otherwise. */
const placesOf = (index: number): readonly ("inline" | "table")[] =>
  process.env.LIGHTWELL_LONG_TESTS ? ["inline", "table"] : [index % 2 ? "inline" : "table"];

describe.each(["glsl", "wgsl"] as const)("%s", (to) => {
  it("of a light map samples its pictures as NumPy does", async () => {
    const graph = await fixture();
    const shader = exportShader(graph, { to, title: "lightmap" });
    const inputs = [...graph.inputs].map(([name, width]) => ({ width, rows: TRUTH.inputs[name]! }));
    const found = await run(to, jobOf(shader, inputs));
    expect(errorOf(found, TRUTH.outputs.radiance)).toBeLessThan(SAMPLED_TOLERANCE);
    for (const name of graph.inputs.keys()) expect(shader.text).toContain(`//   ${name}: `);
    for (const name of shader.pictures.keys()) expect(shader.text).toMatch(new RegExp(`// .*${name}: \\d+ x \\d+ texels`));
  });

  it("of every network equals NumPy, weights in the text and in a table", async () => {
    expect(NETWORKS.length).toBeGreaterThanOrEqual(5);
    for (const [index, { name, graph: whole, inputs: given, outputs, points }] of NETWORKS.entries()) {
      const [output] = [...whole.outputs];
      const graph = { ...whole, outputs: new Map([["radiance", output![1]]]) };
      for (const weights of placesOf(index)) {
        const shader = exportShader(graph, { to, weights });
        const used = shader.text.match(/^\/\/ (?:fn|vec3) lightwell\((.*)\)/m)![1]!;
        const names = [...graph.inputs.keys()].filter((key) => new RegExp(`\\b${key}\\b`).test(used));
        const inputs = names.map((key) => ({
          width: graph.inputs.get(key)!,
          rows: Array.from({ length: points }, (_, point) => row(given[key]!, point)),
        }));
        const found = await run(to, jobOf(shader, inputs));
        const expected = Array.from({ length: points }, (_, point) => row(outputs[output![0]]!, point));
        expect(errorOf(found, expected), `${name} ${weights}`).toBeLessThan(TOLERANCE);
      }
    }
  });
});

/** A field of a door and a crate: numbers of a frame times where the surface is at rest. */
async function movingField(frame = "pose") {
  const { readGraph } = await import("lightwell/graph");
  const data = Float32Array.from({ length: 18 }, (_, i) => Math.sin(i + 1));
  const buffers = new Map<string, StoredBuffer>([
    ["w", { shape: [9, 2], type: "float32", data }],
    ["b", { shape: [9], type: "float32", data: data.slice(9) }],
  ]);
  const json = {
    version: 1,
    inputs: { rest_position: 3, [frame]: 2 },
    buffers: { w: { shape: [9, 2], type: "float32" }, b: { shape: [9], type: "float32" } },
    nodes: [
      { id: "frame", op: "linear", inputs: [frame], weights: "w", bias: "b", per_frame: true },
      { id: "out", op: "matvec", inputs: ["frame", "rest_position"], rows: 3 },
    ],
    outputs: { radiance: "out" },
  };
  return readGraph(json, buffers);
}

it.each(["glsl", "wgsl"] as const)("%s of a field that follows what moves takes the pose, and says its range", async (to) => {
  const graph = await movingField();
  const shader = exportShader(graph, { to, movers: ["Door, 0 to 90 degrees", "crate, 0 to 0.5 metres"] });
  expect(shader.text).toMatch(/\/\/ {3}pose: .*0 at the first value.*\(Door, 0 to 90 degrees\) \(crate, 0 to 0.5 metres\)/);
  const points = [[0, 0], [1, 0], [0.3, 0.8], [1, 1]].map((pose, i) => ({ rest_position: [i - 1, 0.5, 2 - i], pose }));
  const inputs = [...graph.inputs].map(([name, width]) => ({ width, rows: points.map((point) => point[name as "pose"]) }));
  const found = await run(to, jobOf(shader, inputs));
  const expected = points.map((point) => [...evaluate(graph, point).radiance!]);
  expect(errorOf(found, expected)).toBeLessThan(TOLERANCE);
  // The pose is used: the crate alone changes the light.
  expect(Math.abs(found[0]![0]! - found[3]![0]!)).toBeGreaterThan(0.01);
});

it("a Shadertoy shows what moves at rest, and refuses inputs that it cannot make up", async () => {
  const graph = await movingField();
  const shader = exportShader(graph, { to: "shadertoy" });
  expect(shader.text).toContain("lightwell(position, vec2(POSE))");
  await page.evaluate(runShadertoy, shader.text);
  const lamps = await movingField("lamps");
  expect(() => exportShader(lamps, { to: "shadertoy" })).toThrow("expected a field without the input 'lamps'; export glsl instead");
});

/** The whole-network SIREN of a light map: (u, v) and two more numbers to RGB. */
async function siren() {
  const { readGraph } = await import("lightwell/graph");
  const random = (() => {
    let state = 7;
    return () => {
      state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
      return (2 * state) / 2 ** 32 - 1;
    };
  })();
  const widths = [4, 32, 32, 32, 3];
  const values = (count: number, scale: number) => Float32Array.from({ length: count }, () => scale * random());
  const buffers = new Map<string, StoredBuffer>(
    widths.slice(1).flatMap((out, i) => {
      const fan = widths[i]!;
      const scale = i === 0 ? 20 / fan : Math.sqrt(6 / fan);
      return [
        [`w${i}`, { shape: [out, fan], type: "float32" as const, data: values(out * fan, scale) }],
        [`b${i}`, { shape: [out], type: "float32" as const, data: values(out, 0.3) }],
      ] as [string, StoredBuffer][];
    }),
  );
  const nodes: Record<string, unknown>[] = [
    { id: "l", op: "slice", inputs: ["light"], start: 0, width: 2 },
    { id: "x", op: "concat", inputs: ["uv1", "l"] },
  ];
  widths.slice(1).forEach((_, i) => {
    nodes.push({ id: `h${i}`, op: "linear", inputs: [i === 0 ? "x" : `a${i - 1}`], weights: `w${i}`, bias: `b${i}` });
    nodes.push({ id: `a${i}`, op: "activate", inputs: [`h${i}`], function: i < 3 ? "sine" : "sigmoid" });
  });
  const declared = Object.fromEntries([...buffers].map(([name, { shape, type }]) => [name, { shape, type }]));
  const json = { version: 1, inputs: { uv1: 2, light: 3 }, buffers: declared, nodes, outputs: { radiance: "a3" } };
  return readGraph(json, buffers);
}

it("a whole-network SIREN becomes a Shadertoy that compiles, fits and is not blank", async () => {
  const shader = exportShader(await siren(), { to: "shadertoy", title: "siren" });
  expect(shader.text.length).toBeLessThan(65_536);
  expect(shader.text).not.toMatch(/\buniform\b/);
  const pixels = await page.evaluate(runShadertoy, shader.text);
  for (const pixel of pixels) expect(Math.max(...pixel.slice(0, 3))).toBeGreaterThan(30);
  expect(new Set(pixels.map((pixel) => pixel.join())).size).toBe(3);
});

it("refuses what a target cannot hold, and names that are none", async () => {
  const graph = await fixture();
  expect(() => exportShader(graph, { to: "shadertoy" })).toThrow(/shadertoy: expected a field without textures/);
  for (const name of ["", "2x", "a b", "a__b", "x;discard"]) {
    expect(() => exportShader(graph, { to: "glsl", name })).toThrow(/name: expected letters/);
  }
});

it("the built exporter gives the same text as the source", async () => {
  const { graph } = NETWORKS[0]!;
  const [vector] = NETWORKS;
  const arrays = Object.fromEntries(
    [...vector!.buffers].map(([name, { data }]) => [name, Buffer.from(data.buffer, data.byteOffset, data.byteLength).toString("base64")]),
  );
  const json = { ...vector!.json, outputs: { radiance: [...graph.outputs.values()][0] } };
  const request = JSON.stringify({ graph: json, arrays, pictures: {}, options: { to: "glsl" } });
  const program = "require('vm').runInThisContext(fs.readFileSync(process.argv[1],'utf8'));process.stdout.write(lightwellExport(fs.readFileSync(0,'utf8')))";
  const answer = execFileSync("node", ["-e", program, here("../../lightwell/graph/exporter.js")], { input: request });
  const expected = exportShader({ ...graph, outputs: new Map([["radiance", [...graph.outputs.values()][0]!]]) }, { to: "glsl" });
  expect(JSON.parse(answer.toString()).text).toBe(expected.text);
});
