/** Reads a damaged file with everything that reads files in a page, short of drawing, and says how it ended. */

import { FormatError } from "../runtime/src/checks.ts";
import { evaluate, printGlsl, printWgsl, valuesOf } from "../runtime/src/graph/index.ts";
import { LearnedScene } from "../runtime/src/learned-scene.ts";
import { readLibrary } from "../runtime/src/lens/library.ts";
import { learnedLight } from "../runtime/src/loaded-light.ts";
import { LightwellLoaderPlugin, parseLearned } from "../runtime/src/loader.ts";
import { readProbes } from "../runtime/src/probes/file.ts";
import { TRIAL } from "../runtime/src/trial.ts";
import { Box3, Mesh } from "three";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";
import { type GLTF, GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import type { FieldRecord } from "../runtime/src/extension.ts";
import type { Format } from "./files.ts";

/** Texts of one field, to be compiled. */
export interface Shaders {
  readonly glsl: readonly string[];
  readonly wgsl: readonly string[];
}

/** How reading ended: refused with our own error, or accepted; a fault is what must not be. */
export interface Outcome {
  readonly kind: "refused" | "accepted" | "uncaught" | "silent_nan";
  readonly message?: string;
  readonly shaders?: readonly Shaders[];
}

/** Whether something was said on the console. */
let warned = false;
for (const level of ["warn", "error"] as const) {
  console[level] = () => {
    warned = true;
  };
}

/** Read a file. Every fault is part of the result. */
export async function examine(format: Format, file: Uint8Array<ArrayBuffer>): Promise<Outcome> {
  warned = false;
  try {
    if (format === "lwsp") await readLibrary(file);
    else if (format === "lwp") readProbes(file.buffer);
    else return await examineScene(file.buffer);
    return { kind: "accepted" };
  } catch (error) {
    if (error instanceof FormatError) return { kind: "refused", message: error.message };
    return { kind: "uncaught", message: error instanceof Error ? String(error.stack).slice(0, 600) : String(error) };
  }
}

async function examineScene(bytes: ArrayBuffer): Promise<Outcome> {
  const loader = new GLTFLoader().setMeshoptDecoder(MeshoptDecoder);
  const gltf = await parseLearned(loader.register((parser) => new LightwellLoaderPlugin(parser)), bytes);
  const { fields } = learnedLight(gltf);
  const shaders = fields.map(({ graph }) => ({
    glsl: (["inline", "texture"] as const).map((weights) => printGlsl(graph, { name: "field", weights }).code),
    wgsl: (["inline", "storage"] as const).map((weights) => printWgsl(graph, { name: "field", weights, fragment: true }).code),
  }));
  const learned = new LearnedScene(gltf);
  learned.update();
  const fault = notANumber(gltf, fields, learned);
  learned.dispose();
  return fault && !warned ? { kind: "silent_nan", message: fault } : { kind: "accepted", shaders };
}

/** What holds NaN or infinity; null where all is well. */
function notANumber(gltf: GLTF, fields: readonly FieldRecord[], learned: LearnedScene): string | null {
  for (const { graph, buffers, name } of fields) {
    const stored = [...buffers.values()];
    for (const buffer of stored) if (!buffer.picture && !valuesOf(buffer).every(Number.isFinite)) return `weights of ${name}`;
    if (stored.some(({ picture }) => picture)) continue;
    if (!evaluate(graph, TRIAL).radiance!.every(Number.isFinite)) return `radiance of ${name}`;
  }
  for (const { value, intensity, color } of learned.lamps)
    if (![...value.toArray(), intensity, color.r, color.g, color.b].every(Number.isFinite)) return "a lamp";
  let place: string | null = null;
  gltf.scene.traverse((object) => {
    if (object instanceof Mesh && !object.geometry.attributes.position?.array.every(Number.isFinite)) place = "positions";
  });
  const { min, max } = new Box3().setFromObject(gltf.scene);
  const bounds = [...min.toArray(), ...max.toArray()];
  return place ?? (bounds.some(Number.isNaN) ? "bounds" : null);
}
