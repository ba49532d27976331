/** Probe volumes in the browser: GLSL and WGSL mean what the definition means, and light three.js' standard material. */

import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { describe, expect, it } from "vitest";
import { MeshStandardMaterial, ShaderLib } from "three";
import { readProbes } from "../runtime/src/probes/file.ts";
import { ProbeVolume } from "../runtime/src/probes/volume.ts";
import { bundle, gzipped, NOT_OURS } from "./support/bundle.ts";
import { openModule } from "./support/module-page.ts";

const fixture = (name: string) => readFileSync(fileURLToPath(new URL(`fixtures/${name}`, import.meta.url)));
const [MADE_UP, ROOMS] = [fixture("probes.lwp"), fixture("probe-rooms.lwp")];
const bytesOf = (file: Buffer) => file.buffer.slice(file.byteOffset, file.byteOffset + file.length) as ArrayBuffer;
const TRUTH = JSON.parse(fixture("probes.json").toString()) as Record<"place" | "normal" | "irradiance", number[][]> & { trust: number[] };
type Told = Record<"place" | "normal" | "irradiance", number[][]> & { file: string; trust: number[] };
const MORE = JSON.parse(fixture("probe-functions.json").toString()) as { functions: Record<string, Told>; baselines: { file: string; modes: Record<string, Told> } };
/** Trust is the sum of hat · ρ: the shaders' tolerance of ρ. */
const TOLERANCE = 2 / 255;

const opened = openModule("probes.ts", "probes");

describe.each(["webgl", "webgpu"] as const)("on %s", (kind) => {
  it("answers as the definition does, bricks and fallback included", async () => {
    const { place, normal, irradiance, trust } = TRUTH;
    const asked = { file: MADE_UP.toString("base64"), place, normal };
    const { data } = await opened.page.evaluate(([k, q]) => window.probes[k](q), [kind, asked] as const);
    let [worst, error] = [0, 0];
    trust.forEach((z, i) => {
      worst = Math.max(worst, Math.abs(data[4 * i + 3]! - z));
      // Where next to nothing is trusted, the division magnifies rounding.
      if (z > 0.01) irradiance[i]!.forEach((e, c) => (error = Math.max(error, Math.abs(data[4 * i + c]! - e) / (1 + e))));
    });
    expect(worst).toBeLessThan(TOLERANCE);
    expect(error).toBeLessThan(TOLERANCE);
    // A planted bug: the wrong normal shows.
    const turned = { ...asked, normal: normal.map(([x, y, z]) => [y!, z!, x!]) };
    const wrong = await opened.page.evaluate(([k, q]) => window.probes[k](q), [kind, turned] as const);
    expect(Math.max(...irradiance.map((e, i) => Math.abs(wrong.data[4 * i]! - e[0]!)))).toBeGreaterThan(0.05);
  });
});

describe.each(["webgl", "webgpu"] as const)("on %s", (kind) => {
  it.each(Object.keys(MORE.functions))("runs the weight function %s", async (name) => {
    const { file, place, normal, trust, irradiance } = MORE.functions[name]!;
    const { data } = await opened.page.evaluate(([k, q]) => window.probes[k](q), [kind, { file, place, normal }] as const);
    let [worst, error] = [0, 0];
    trust.forEach((z, i) => {
      worst = Math.max(worst, Math.abs(data[4 * i + 3]! - z));
      if (z > 0.01) irradiance[i]!.forEach((e, c) => (error = Math.max(error, Math.abs(data[4 * i + c]! - e) / (1 + e))));
    });
    expect(worst).toBeLessThan(TOLERANCE);
    expect(error).toBeLessThan(TOLERANCE);
  });
});

it.each(Object.keys(MORE.baselines.modes))("answers by a baseline: mode %s", async (mode) => {
  const { place, normal, irradiance } = MORE.baselines.modes[mode]!;
  const file = MORE.baselines.file;
  const { data } = await opened.page.evaluate((q) => window.probes.webgl(q), { file, place, normal, mode: Number(mode) });
  const errors = irradiance.map((e, i) => Math.abs(data[4 * i]! - e[0]!) / (1 + e[0]!));
  // Weights below 0.2 are crushed to their cube: rounding beside the edge shows.
  expect(errors.sort((a, b) => a - b)[Math.floor(0.99 * errors.length)]).toBeLessThan(0.01);
  const learned = await opened.page.evaluate((q) => window.probes.webgl(q), { file, place, normal });
  expect(Math.max(...irradiance.map((e, i) => Math.abs(learned.data[4 * i]! - e[0]!)))).toBeGreaterThan(0.05);
});

const KINDS = ["webgl", "webgpu", "fallback"] as const;

it.each(KINDS)("lights a standard material: %s", async (kind) => {
  const place: [number, number, number] = [-1.5, 1.3, 1.5];
  const file = ROOMS.toString("base64");
  const data = await opened.page.evaluate(([k, f, p]) => window.probes.ball(k, f, p), [kind, file, place] as const);
  const size = Math.sqrt(data.length / 4);
  const middle = 4 * ((size / 2) * size + size / 2);
  const front = { file, place: [[place[0], place[1], place[2] + 0.4]], normal: [[0, 0, 1]] };
  const { data: expected } = await opened.page.evaluate((q) => window.probes.webgl(q), front);
  // Diffuse light alone: albedo 1, E / π.
  for (let c = 0; c < 3; c++) expect(Math.abs((data[middle + c]! * Math.PI) / expected[c]! - 1)).toBeLessThan(0.05);
  expect(Math.min(...data.filter((_, i) => i % 4 === 0))).toBeGreaterThanOrEqual(0);
});

it("stops light at the wall that trilinear weights leak through", async () => {
  const place = Array.from({ length: 24 }, (_, i) => [0.04 + 0.01 * i, 1.2, 0.4]);
  const asked = { file: ROOMS.toString("base64"), place, normal: place.map(() => [1, 0, 0]) };
  const mean = async (mode: number) => {
    const { data } = await opened.page.evaluate((q) => window.probes.webgl(q), { ...asked, mode });
    return place.reduce((sum, _, i) => sum + data[4 * i]!, 0) / place.length;
  };
  const [learned, plain] = [await mean(0), await mean(1)];
  expect(learned).toBeLessThan(plain);
  expect(learned).toBeGreaterThan(0);
});

it("reads what a bake writes, and refuses what is damaged", () => {
  const rooms = readProbes(bytesOf(ROOMS));
  expect(rooms.probes).toBeGreaterThan(100);
  const text = bytesOf(MADE_UP);
  for (const size of [0, 7, 20, 200, text.byteLength - 4]) expect(() => readProbes(text.slice(0, size))).toThrow("probes: damaged");
  let refused = 0;
  for (let seed = 1; seed < 60; seed++) {
    const broken = new Uint8Array(text.slice(0));
    for (let k = 0; k < 8; k++) broken[(seed * 7919 + k * 104729) % broken.length] = (seed * 31 + k * 17) & 255;
    try {
      readProbes(broken.buffer);
    } catch (error) {
      expect(String(error)).toMatch(/^FormatError: probes: damaged/);
      refused++;
    }
  }
  expect(refused).toBeGreaterThan(5);
});

/** The shader of a material as three.js asks for it. */
function shaderOf(material: MeshStandardMaterial): string {
  const { vertexShader, fragmentShader } = ShaderLib.physical;
  const shader = { uniforms: {}, vertexShader, fragmentShader };
  material.onBeforeCompile(shader as never, null as never);
  return shader.fragmentShader;
}

it("lights a material once, however often it is asked to", () => {
  const [material, volume] = [new MeshStandardMaterial(), new ProbeVolume(bytesOf(ROOMS))];
  const use = volume.light(material);
  const once = shaderOf(material);
  expect(volume.light(material, true)).toBe(use);
  expect(use.offset.value).toBeGreaterThan(0);
  expect(shaderOf(material)).toBe(once);
  expect(once.split(`uniform highp usampler2D ${volume.name}_words;`)).toHaveLength(2);
});

it("keeps materials with hooks of their own apart", () => {
  const volume = new ProbeVolume(bytesOf(ROOMS));
  const keys = ["red", "blue"].map((name) => {
    const material = new MeshStandardMaterial();
    material.onBeforeCompile = name === "red" ? (shader) => void (shader.fragmentShader += "// red") : (shader) => void (shader.fragmentShader += "// blue");
    volume.light(material);
    return material.customProgramCacheKey();
  });
  expect(new Set(keys).size).toBe(2);
  for (const key of keys) expect(key).toContain(volume.name);
});

it("says which part of a shader is missing that its light goes into", () => {
  const material = new MeshStandardMaterial();
  new ProbeVolume(bytesOf(ROOMS)).light(material);
  const shader = { uniforms: {}, vertexShader: "#include <common>\n#include <project_vertex>", fragmentShader: "#include <common>\n#include <opaque_fragment>" };
  expect(() => material.onBeforeCompile(shader as never, null as never)).toThrow("expected '#include <lights_fragment_maps>' in a shader of three.js, found none");
});

// `benchmarks/light_probes.py` asks for it: a quarter of a minute of a quiet machine.
it.each(process.env.LIGHTWELL_MEASURE ? [""] : [])("takes a time, which the benchmark reads", async () => {
  // Places in the order of the lattice, as pixels have it.
  const place = Array.from({ length: 1024 }, (_, i) => [-2.9 + (5.8 * i) / 1024, 1.2, 0.4]);
  const asked = { file: ROOMS.toString("base64"), place, normal: place.map(() => [0, 1, 0]), repeat: 256 };
  const nanoseconds: Record<string, number> = {};
  const take = async (name: string, query: typeof asked & { mode?: number }) => {
    const times: number[] = [];
    for (let k = 0; k < 5; k++) times.push((await opened.page.evaluate((q) => window.probes.webgl(q), query)).milliseconds);
    nanoseconds[name] = (1e6 * times.sort((a, b) => a - b)[2]!) / (1024 * 256);
  };
  await take("learned", { ...asked, mode: 0 });
  await take("trilinear", { ...asked, mode: 1 });
  // The made-up lattice, in which the other functions and distance moments are at hand: every third probe is weighted.
  const inside = { ...asked, place: place.map((_, i) => [-0.9 + (2.7 * i) / 1024, 1.2, 3.4]) };
  await take("made up, relu-field", { ...inside, file: MORE.baselines.file, mode: 0 });
  await take("made up, DDGI", { ...inside, file: MORE.baselines.file, mode: 3 });
  for (const name of ["product-field", "mlp"]) await take(`made up, ${name}`, { ...inside, file: MORE.functions[name]!.file });
  expect(nanoseconds.learned).toBeGreaterThan(0);
  const folder = fileURLToPath(new URL("../test-results/", import.meta.url));
  mkdirSync(folder, { recursive: true });
  writeFileSync(`${folder}probes.json`, `${JSON.stringify({ renderer: "WebGL 2 on SwiftShader", nanoseconds }, null, 1)}\n`);
});

it("is small", async () => {
  const sizes = await Promise.all(
    ['export * from "lightwell/probes";', 'export { ProbeVolumeLight, ProbeVolume } from "lightwell/probes/webgpu";'].map(async (text) =>
      gzipped(await bundle(text, { external: NOT_OURS })),
    ),
  );
  console.log(`lightwell/probes ${sizes[0]} B gzipped, lightwell/probes/webgpu ${sizes[1]} B`);
  expect(Math.max(...sizes)).toBeLessThan(9_400);
});
