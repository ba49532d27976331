/** Files that earlier versions of lightwell wrote (tests/compatibility) are read here too, and mean what they meant. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { inflateRawSync } from "node:zlib";
import { readContainer } from "lightwell";
import { expect, it } from "vitest";
import { readExtension } from "../runtime/src/extension.ts";
import { evaluate, printGlsl, printWgsl } from "../runtime/src/graph/index.ts";
import { readProbes } from "../runtime/src/probes/file.ts";
import { probesGlsl } from "../runtime/src/probes/shader.ts";

const file = (name: string) => new Uint8Array(readFileSync(fileURLToPath(new URL(`../../tests/compatibility/0.1.0/${name}`, import.meta.url))));

/** Rows of numbers by name: the float32 arrays of an .npz file, a ZIP archive of .npy files. */
function readNpz(bytes: Uint8Array): Map<string, number[][]> {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const arrays = new Map<string, number[][]>();
  let end = bytes.length - 22;
  while (view.getUint32(end, true) !== 0x06054b50) end--;
  for (let k = 0, at = view.getUint32(end + 16, true); k < view.getUint16(end + 10, true); k++) {
    const [method, stored] = [view.getUint16(at + 10, true), view.getUint32(at + 20, true)];
    const [name, extra, comment] = [28, 30, 32].map((offset) => view.getUint16(at + offset, true)) as [number, number, number];
    const title = new TextDecoder().decode(bytes.subarray(at + 46, at + 46 + name)).replace(/\.npy$/, "");
    const local = view.getUint32(at + 42, true);
    const begin = local + 30 + view.getUint16(local + 26, true) + view.getUint16(local + 28, true);
    const packed = bytes.subarray(begin, begin + stored);
    const data = method ? new Uint8Array(inflateRawSync(packed)) : packed;
    const head = 10 + new DataView(data.buffer, data.byteOffset).getUint16(8, true);
    const told = new TextDecoder().decode(data.subarray(10, head));
    const shape = /'shape': \((\d+), (\d+)\)/.exec(told);
    if (told.includes("'<f4'") && shape) {
      const numbers = new Float32Array(data.slice(head).buffer);
      const width = Number(shape[2]);
      arrays.set(title, Array.from({ length: Number(shape[1]) }, (_, i) => [...numbers.slice(i * width, (i + 1) * width)]));
    }
    at += 46 + name + extra + comment;
  }
  return arrays;
}

const EXPECTED = readNpz(file("expected.npz"));

/** The arrays whose names begin with a word, by the rest of their names. */
const under = (prefix: string) =>
  new Map([...EXPECTED].filter(([name]) => name.startsWith(prefix)).map(([name, rows]) => [name.slice(prefix.length), rows]));

/** What the extension of an asset declares; pictures are not decoded, their sizes are those that it states. */
async function read(name: string) {
  const { json, binary } = readContainer(file(`${name}.glb`));
  const views = json.bufferViews as { byteOffset?: number; byteLength: number }[];
  const shapes = new Map<number, number[]>();
  for (const field of (json as any).extensions.LIGHTWELL_neural_radiance.fields)
    for (const buffer of Object.values<any>(field.graph.buffers)) if ("texture" in buffer) shapes.set(buffer.texture, buffer.shape);
  return (await readExtension(json, {
    bufferView: async (index) => {
      const { byteOffset = 0, byteLength } = views[index]!;
      return binary!.slice(byteOffset, byteOffset + byteLength).buffer as ArrayBuffer;
    },
    texture: async (index) => ({ source: null, height: shapes.get(index)![0]!, width: shapes.get(index)![1]! }),
  }))!;
}

it.each(["factored", "kdtree", "probes"])("%s.glb evaluates to the stored values", async (name) => {
  const { fields } = await read(name);
  expect(fields.length).toBeGreaterThan(0);
  for (const field of fields) {
    const [given, wanted] = [under(`${name}.${field.name}.in.`), under(`${name}.${field.name}.out.`)];
    expect([...wanted.keys()]).toContain("radiance");
    wanted.get("radiance")!.forEach((_, row) => {
      const found = evaluate(field.graph, Object.fromEntries([...given].map(([input, rows]) => [input, rows[row]!])));
      for (const [output, rows] of wanted)
        rows[row]!.forEach((value, k) => expect(Math.abs(found[output]![k]! - value)).toBeLessThan(1e-4 + 1e-3 * Math.abs(value)));
    });
  }
});

it("lightmap.glb is read, and becomes shaders", async () => {
  const { fields } = await read("lightmap");
  for (const { graph } of fields) {
    expect(printGlsl(graph, { name: "f", weights: "texture" }).code).toContain("texture");
    expect(printWgsl(graph, { name: "f", weights: "storage" }).code.length).toBeGreaterThan(500);
  }
});

it("probes.lwp is read, and becomes a shader", () => {
  const volume = readProbes(file("probes.lwp").buffer);
  expect(volume.probes).toBeGreaterThan(0);
  expect(probesGlsl(volume, "f")).toContain("f");
});
