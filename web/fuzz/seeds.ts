/** The files that are damaged: small, and between them with every op, storage type and part of the formats. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { expertField } from "../test/support/experts.ts";
import { furnishedRoom, linearField, plainRoom, stillField } from "../test/support/fixtures.ts";
import { type FixtureField, writeGlb } from "../test/support/glb.ts";
import type { Format } from "./files.ts";

/** A file to be damaged. */
export interface Seed {
  readonly format: Format;
  readonly name: string;
  readonly bytes: Uint8Array;
}

const root = process.env.LIGHTWELL_ROOT ?? fileURLToPath(new URL("../../", import.meta.url));
const read = (path: string) => new Uint8Array(readFileSync(`${root}/${path}`));

/** Vectors whose graphs become fields: with a value of three components that `radiance` can be. */
const VECTORS = ["network_encoded_float16", "network_factored", "hashgrid_4x2_8", "network_segments", "nearest_3x3x3x12"] as const;
const INPUTS = ["position", "normal", "view", "light", "shading_normal", "uv", "uv1", "reflectance", "roughness", "metallic"];

/** A field made of a test vector, whose inputs are renamed or padded to those of a surface. */
function vectorField(name: string): FixtureField {
  const { graph, arrays } = JSON.parse(readFileSync(`${root}/format/vectors/${name}.json`, "utf8"));
  const buffers = Object.fromEntries(Object.entries<any>(graph.buffers).map(([key, form]) => [key, { ...form, values: arrays[key] }]));
  const nodes: any[] = [];
  const inputs: Record<string, number> = { position: 3 };
  for (const [key, width] of Object.entries<number>(graph.inputs)) {
    if (key === "position" || key === "light") {
      inputs[key] = 3;
      continue;
    }
    // Whatever the vector's input is, components of the position stand in for it.
    nodes.push({ id: `all_${key}`, op: "concat", inputs: Array(Math.ceil(width / 3)).fill("position") });
    nodes.push({ id: key, op: "slice", inputs: [`all_${key}`], start: 0, width });
  }
  nodes.push(...graph.nodes);
  const value = graph.outputs.radiance ?? Object.values(graph.outputs)[0];
  nodes.push({ id: "three", op: "concat", inputs: [value, "position"] }, { id: "first_three", op: "slice", inputs: ["three"], start: 0, width: 3 });
  const renamed = nodes.map((node) => (INPUTS.includes(node.id) ? { ...node, id: `${node.id}_` } : node));
  return { name, role: "indirect", variable: 0, graph: { version: 1, inputs, buffers, nodes: renamed, outputs: { radiance: "first_three" } } };
}

/** All seeds, in a fixed order. */
export function seeds(): Seed[] {
  const scenes: [string, Uint8Array][] = [
    ["room", writeGlb(plainRoom())],
    ["furnished", writeGlb(furnishedRoom({ fields: [linearField(), stillField()] }))],
    ["experts", writeGlb(plainRoom({ fields: [expertField()] }))],
    ...VECTORS.map((name): [string, Uint8Array] => [name, writeGlb(plainRoom({ fields: [vectorField(name)] }))]),
    ["lightmap", read("web/test/fixtures/lightmap.glb")],
  ];
  return [
    ...scenes.map(([name, bytes]) => ({ format: "glb" as const, name, bytes })),
    { format: "lwp", name: "probes", bytes: read("web/test/fixtures/probe-rooms.lwp") },
    { format: "lwsp", name: "disc", bytes: read("lightwell/lens/standard/disc-32.lwsp") },
  ];
}
