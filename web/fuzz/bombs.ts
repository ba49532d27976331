/** Small files that ask for a large amount of work or memory. */

import type { Random } from "./random.ts";

type Json = any;

const fieldOf = (json: Json): Json => json.extensions?.LIGHTWELL_neural_radiance?.fields?.[0];

/** A chain of nodes of a graph after `position`, each of which asks for something. */
function chain(json: Json, count: number, node: (i: number, before: string) => Json, width = 3): void {
  const field = fieldOf(json);
  if (!field) return;
  const nodes: Json[] = [];
  let before = "position";
  for (let i = 0; i < count; i++) {
    const made = { id: `n${i}`, inputs: [before], ...node(i, before) };
    nodes.push(made);
    before = made.id;
  }
  nodes.push({ id: "end", op: "slice", inputs: [before], start: 0, width: Math.min(width, 3) });
  field.graph = { version: 1, inputs: { position: 3 }, buffers: {}, nodes, outputs: { radiance: "end" } };
}

const wide = (inputs: number) => (before: string) => ({ op: "concat", inputs: Array(inputs).fill(before) });

/** 104 kB of JSON, tens of megabytes of text if it were printed: `count` sums of two values of 4,080 components. */
export function wideSums(json: Json, count: number): void {
  chain(json, count + 2, (i, before) => (i === 0 ? wide(255)(before) : i === 1 ? { op: "concat", inputs: Array(5).fill(before) } : { op: "add", inputs: [before, before] }));
}

/** A kilobyte of JSON, hundreds of gigabytes on a GPU: vertices that have no bytes in the file, and one accessor for all morph targets. */
export function manyMorphs(json: Json, vertices = 5_000_000, targets = 1024): void {
  const primitive = json.meshes?.[0]?.primitives?.[0];
  if (!primitive) return;
  const all = json.accessors.push({ componentType: 5126, type: "VEC3", count: vertices }) - 1;
  primitive.attributes = { POSITION: all };
  primitive.targets = Array.from({ length: targets }, () => ({ POSITION: all, NORMAL: all }));
}

const BOMBS: readonly ((json: Json, random: Random) => void)[] = [
  (json, random) => wideSums(json, random.of([1, 30, 500, 2003, 4000])),
  (json) => chain(json, 4000, () => ({ op: "frequency", octaves: 24 })),
  (json) => chain(json, 2000, (i, before) => (i % 2 ? { op: "slice", start: 0, width: 3 } : { op: "oneblob", inputs: [before], bins: 256 })),
  (json) => chain(json, 4000, () => ({ op: "activate", function: "sine" })),
  (json) => chain(json, 3, (i, before) => (i === 0 ? wide(255)(before) : i === 1 ? { op: "slice", start: 0, width: 64 } : { op: "frequency", octaves: 24 })),
  // Values that all stay alive until the last node reads them.
  (json) => {
    chain(json, 255, (i) => ({ id: `k${i}`, op: "frequency", inputs: ["position"], octaves: 24 }));
    const graph = fieldOf(json)?.graph;
    if (graph) graph.nodes.at(-1).inputs = ["k0"];
    graph?.nodes.splice(-1, 0, { id: "sum", op: "add", inputs: ["k0", "k254"] });
  },
  // Overflow: finite weights whose light is none.
  (json) => chain(json, 12, (_i, before) => ({ op: "multiply", inputs: [before, before] })),
  (json) => chain(json, 2, (i) => ({ op: "affine", scale: Array(3).fill(i ? 3e38 : 0), offset: Array(3).fill(3e38) })),
  (json) => void (json.accessors = Array.from({ length: 12_000 }, () => ({ ...json.accessors[0] }))),
  (json) => void (json.accessors[0] = { componentType: 5126, type: "VEC3", count: 100_000_000 }),
  (json) => {
    const sparse = { count: 1, indices: { bufferView: 0, componentType: 5125 }, values: { bufferView: 0 } };
    json.accessors[0] = { componentType: 5126, type: "VEC3", count: 80_000_000, sparse };
  },
  (json) => void (json.nodes = [...json.nodes, ...Array.from({ length: 100_000 }, () => ({ mesh: 0 }))]),
  (json, random) => {
    const depth = random.of([900, 3_990, 50_000]);
    const first = json.nodes.length;
    json.nodes = [...json.nodes, ...Array.from({ length: depth }, (_, i) => ({ scale: [1e12, 1e12, 1e12], ...(i + 1 < depth ? { children: [first + i + 1] } : { mesh: 0 }) }))];
    json.scenes[0].nodes.push(first);
  },
  (json) => {
    const packed = { buffer: 0, byteLength: 16, byteStride: 4, count: 2 ** 27, mode: "ATTRIBUTES" };
    json.bufferViews[0] = { buffer: 0, byteLength: 2 ** 29, extensions: { EXT_meshopt_compression: packed } };
    json.buffers[0].byteLength = 2 ** 30;
  },
  (json) => {
    // The head of a PNG of 60,000 × 60,000.
    const uri = "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAA6mAAAOpgCAIAAAA=";
    json.images = [{ uri, mimeType: "image/png" }];
    json.textures = [{ source: 0 }];
    json.materials[0].emissiveTexture = { index: 0 };
  },
  (json) => void (json.materials[0].name = "n".repeat(3_000_000)),
  (json) => void (json.nodes[0].extensions = { EXT_mesh_gpu_instancing: { attributes: { TRANSLATION: 0, ROTATION: 0 } } }),
  (json) => manyMorphs(json),
  (json) => {
    const field = fieldOf(json);
    if (field) json.extensions.LIGHTWELL_neural_radiance.fields = Array.from({ length: 8 }, () => structuredClone(field));
  },
];

/** Turn a document into one that asks for too much. */
export function bomb(json: Json, random: Random): void {
  random.of(BOMBS)(json, random);
}
