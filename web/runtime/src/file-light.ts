/** The learned light of a file for a model that was loaded elsewhere. */

import type { Object3D } from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import { FormatError } from "./checks.ts";
import { checkContainer, checkSelfContained, type GltfJson, readContainer } from "./container.ts";
import { learnedLight } from "./loaded-light.ts";
import { type LoaderOptions, LightwellLoaderPlugin } from "./loader.ts";

/** Tables of a document that learned light is made of. */
const KEPT = ["asset", "extensions", "accessors", "bufferViews", "buffers", "textures", "images", "samplers"];
/** Extensions of those tables. */
const KEPT_EXTENSIONS = /^(LIGHTWELL_neural_radiance|EXT_texture_webp|KHR_texture_basisu|(EXT|KHR)_meshopt_compression|KHR_mesh_quantization)$/;

const MAGIC = 0x46546c67;
const JSON_CHUNK = 0x4e4f534a;
const BINARY_CHUNK = 0x004e4942;

/**
 * What a loader would return for a model with the learned light of a baked file; of the file's own model nothing is loaded. Rejects with a
 * `FormatError` when the file has no learned light or is not as `format/FORMAT.md` says, and with an `Error` when it cannot be fetched.
 */
export async function fileLight(source: string | ArrayBuffer, model: Object3D, options: LoaderOptions): Promise<GLTF> {
  const bytes = typeof source === "string" ? await download(source) : source;
  const { json, binary } = readContainer(new Uint8Array(bytes));
  checkSelfContained(json);
  checkContainer(json, binary);
  const { GLTFLoader } = await import("three/addons/loaders/GLTFLoader.js");
  const loader = new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser, options));
  const gltf = await loader.parseAsync(pack(bare(json), binary), "");
  if (learnedLight(gltf).fields.length === 0) throw new FormatError("the file: expected learned light, found none; bake it, or pass another file");
  return { ...gltf, scene: model } as GLTF;
}

async function download(url: string): Promise<ArrayBuffer> {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`loadLight: ${url}: expected a file, found status ${response.status}`);
  return response.arrayBuffer();
}

/** An animation of a document whose form was checked. */
interface Animated {
  readonly channels: readonly { readonly target: { readonly node?: number; readonly extensions?: unknown } }[];
}

/** A document without its model. */
function bare(json: GltfJson): object {
  const kept = Object.entries(json).filter(([name]) => KEPT.includes(name));
  // The pointers to lamps; what else is animated belongs to the model.
  const animations = ((json.animations ?? []) as Animated[]).map((animation) => ({
    ...animation,
    channels: animation.channels.filter(({ target }) => target.node === undefined && target.extensions),
  }));
  const names = (list: unknown) => ((list ?? []) as string[]).filter((name) => KEPT_EXTENSIONS.test(name));
  return {
    ...Object.fromEntries(kept),
    extensionsUsed: names(json.extensionsUsed),
    extensionsRequired: names(json.extensionsRequired),
    ...(animations.length > 0 ? { animations } : {}),
    scene: 0,
    scenes: [{}],
  };
}

/** A GLB of a document and a binary chunk. */
function pack(json: object, binary: Uint8Array | null): ArrayBuffer {
  const text = new TextEncoder().encode(JSON.stringify(json));
  const padded = Math.ceil(text.length / 4) * 4;
  const size = 20 + padded + (binary ? 8 + binary.length : 0);
  const bytes = new Uint8Array(size).fill(0x20, 20);
  const words = new DataView(bytes.buffer);
  [MAGIC, 2, size, padded, JSON_CHUNK].forEach((word, i) => words.setUint32(4 * i, word, true));
  bytes.set(text, 20);
  if (!binary) return bytes.buffer;
  words.setUint32(20 + padded, binary.length, true);
  words.setUint32(24 + padded, BINARY_CHUNK, true);
  bytes.set(binary, 28 + padded);
  return bytes.buffer;
}
