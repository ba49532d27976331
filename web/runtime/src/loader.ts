/** three.js GLTFLoader plugin that reads the learned light of a glTF file. */

import { type AnimationClip, type BufferAttribute, type Material, Mesh, NoColorSpace, type Object3D, type Texture } from "three";
import type { GLTF, GLTFLoader, GLTFLoaderPlugin, GLTFParser } from "three/addons/loaders/GLTFLoader.js";
import type { KTX2Loader } from "three/addons/loaders/KTX2Loader.js";
import { fail, FormatError } from "./checks.ts";
import { checkContainer, checkSelfContained, type GltfJson, readContainer } from "./container.ts";
import type { NeuralRadiance, Sources } from "./extension.ts";
import { type Budget, budgetOf } from "./graph/budget.ts";
import { LIMITS } from "./limits.ts";
import { LIGHTMAP_EXTENSION, readLightmap } from "./lightmap.ts";
import { EXTENSION } from "./extension-name.ts";
import type { Lightmap, LoadedLight } from "./loaded-light.ts";
import type { MoverRecord } from "./mover-record.ts";
import { NO_LIGHT } from "./no-light.ts";

const MESHOPT = /^(EXT|KHR)_meshopt_compression$/;

/** A `WebGLRenderer`, or a `WebGPURenderer` that is initialised. */
type FileRenderer = Parameters<KTX2Loader["detectSupport"]>[0];

/** Options of a `LightwellLoaderPlugin`. */
export interface LoaderOptions {
  /** Raises or lowers what the learned light of a file may ask for, such as `{ work: 400_000 }`. */
  readonly budget?: Partial<Budget>;
  /** What will draw the file: its KTX2 textures are then decoded for it, by three.js' decoder, which is loaded when a file has some. */
  readonly renderer?: FileRenderer;
}

/** One decoder of KTX2 for each renderer: every decoder has workers of its own. */
const textureDecoders = new WeakMap<FileRenderer, KTX2Loader>();

/**
 * Puts the checked extension on `gltf.userData.lightwell`.
 *
 * ```ts
 * const loader = new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser));
 * const gltf = await loader.loadAsync("scene.glb");
 * const scene = new LearnedScene(gltf);
 * ```
 */
export class LightwellLoaderPlugin implements GLTFLoaderPlugin {
  readonly name = EXTENSION;
  private readonly parser: GLTFParser;
  private readonly budget: Budget;
  private readonly renderer: FileRenderer | undefined;

  constructor(parser: GLTFParser, options: LoaderOptions = {}) {
    this.parser = parser;
    this.budget = budgetOf(options.budget);
    this.renderer = options.renderer;
  }

  /** Rejects a document that a loader could not read safely, before anything of it is loaded. */
  async beforeRoot(): Promise<void> {
    const { body } = (this.parser.extensions.KHR_binary_glTF ?? {}) as { body?: ArrayBuffer | null };
    checkContainer(this.parser.json as GltfJson, body ? new Uint8Array(body) : null);
    await Promise.all([this.bringDecoder(), this.bringTextureDecoder()]);
  }

  /** Load three.js' decoder of compressed meshes when a file has some and the loader was given none. */
  private async bringDecoder(): Promise<void> {
    const { json, options } = this.parser as unknown as { json: { extensionsUsed?: string[] }; options: { meshoptDecoder?: unknown } };
    if (options.meshoptDecoder || !json.extensionsUsed?.some((name) => MESHOPT.test(name))) return;
    const { MeshoptDecoder } = await import("three/addons/libs/meshopt_decoder.module.js");
    await MeshoptDecoder.ready;
    options.meshoptDecoder = MeshoptDecoder;
  }

  /** The same for KTX2 textures, which are decoded to what the renderer takes. */
  private async bringTextureDecoder(): Promise<void> {
    const { json, options } = this.parser as unknown as { json: { extensionsUsed?: string[] }; options: { ktx2Loader?: unknown } };
    if (options.ktx2Loader || !this.renderer || !json.extensionsUsed?.includes("KHR_texture_basisu")) return;
    const { KTX2Loader } = await import("three/addons/loaders/KTX2Loader.js");
    if (!textureDecoders.has(this.renderer)) textureDecoders.set(this.renderer, new KTX2Loader().detectSupport(this.renderer));
    options.ktx2Loader = textureDecoders.get(this.renderer);
  }

  async afterRoot(gltf: GLTF): Promise<void> {
    const { parser } = this;
    const sources: Sources = {
      bufferView: (index) => parser.getDependency("bufferView", index) as Promise<ArrayBuffer>,
      texture: (index) => loadPicture(parser, index),
    };
    const radiance = await readRadiance(parser.json as GltfJson, sources, this.budget);
    warnOfPlaces(gltf);
    const lightmaps = await readLightmaps(gltf, parser);
    if (radiance || lightmaps.size > 0) {
      const moving = radiance?.movers.length ? await makerOf(radiance.movers, parser) : null;
      const playing = radiance?.lamps.length && (parser.json as GltfJson).animations ? await playerOf(radiance.lamps.length, parser) : null;
      const loaded: LoadedLight = { ...(radiance ?? NO_LIGHT), lightmaps, moving, playing, turning: await turningOf(radiance), surrounding: await surroundingOf(radiance, parser) };
      gltf.userData.lightwell = loaded;
    }
  }
}

/** What makes the movers of a file, loaded where it has some. */
async function makerOf(records: readonly MoverRecord[], parser: GLTFParser): Promise<NonNullable<LoadedLight["moving"]>> {
  const { Mover } = await import("./movers.ts");
  const load = async (record: MoverRecord) => {
    const nodes = record.kind === "clip" ? record.nodes : [record.node];
    const objects = (await Promise.all(nodes.map((node) => parser.getDependency("node", node)))) as Object3D[];
    const clip = record.kind === "clip" ? ((await parser.getDependency("animation", record.animation)) as AnimationClip) : null;
    return { record, objects, clip };
  };
  const loaded = await Promise.all(records.map(load));
  return (root, lightmaps) => loaded.map(({ record, objects, clip }) => new Mover(record, objects, root, clip, lightmaps));
}

/** What makes the lamp of an environment that turns, loaded where one does. */
async function turningOf(radiance: NeuralRadiance | null): Promise<LoadedLight["turning"]> {
  if (!radiance?.variables.some(({ kind }) => kind === "environment")) return null;
  const { TurningLamp } = await import("./turning-lamp.ts");
  return (variable, root) => new TurningLamp(variable, root);
}

/** The picture of what surrounds a scene. What decodes it is loaded where there is one. */
async function surroundingOf(radiance: NeuralRadiance | null, parser: GLTFParser): Promise<LoadedLight["surrounding"]> {
  const texture = radiance?.environment?.texture ?? null;
  if (texture === null) return null;
  const [{ environmentPicture }, data] = await Promise.all([import("./environment-picture.ts"), loadData(parser, texture)]);
  return environmentPicture(data, `textures[${texture}]`);
}

/** What plays the animations of lamps of a file, loaded where it may have some. */
async function playerOf(lamps: number, parser: GLTFParser): Promise<LoadedLight["playing"]> {
  const { LampPlayer, readLampClips } = await import("./lamp-clips.ts");
  const clips = await readLampClips(parser.json as GltfJson, lamps, (index) => parser.getDependency("accessor", index) as Promise<BufferAttribute>);
  return clips.length > 0 ? (switches) => new LampPlayer(clips, switches) : null;
}

/** The learned light of a document. What reads it is loaded when a file has some. */
async function readRadiance(json: GltfJson, sources: Sources, budget: Budget): Promise<NeuralRadiance | null> {
  const { extensions } = json as { extensions?: Record<string, unknown> };
  if (extensions?.[EXTENSION] === undefined) return null;
  const { readExtension } = await import("./extension.ts");
  return readExtension(json, sources, budget);
}

/**
 * Load a GLB from memory with a loader that has the plug-in. Nothing outside of the file is looked up, and whatever is wrong
 * with it is a `FormatError` in one line, also where three.js would throw something else.
 *
 * Args: the loader; the bytes of the file. Returns what `loader.parseAsync` gives.
 */
export async function parseLearned(loader: GLTFLoader, bytes: ArrayBuffer): Promise<GLTF> {
  const { json, binary } = readContainer(new Uint8Array(bytes));
  checkSelfContained(json);
  checkContainer(json, binary);
  try {
    return await loader.parseAsync(bytes, "");
  } catch (error) {
    if (error instanceof FormatError) throw error;
    const said = (error instanceof Error ? error.message : String(error)).split("\n")[0]!.slice(0, 160);
    throw new FormatError(`the file: expected a glTF that three.js can load, found one of which it says "${said}"; export it again`, { cause: error });
  }
}

/** Says so when a vertex or a mesh has no place: its triangles are drawn anywhere or nowhere. */
function warnOfPlaces(gltf: GLTF): void {
  const seen = new Set<unknown>();
  gltf.scene.updateMatrixWorld(true);
  gltf.scene.traverse((object) => {
    if (!(object instanceof Mesh)) return;
    if (!object.matrixWorld.elements.every(Number.isFinite))
      console.warn(`lightwell: mesh '${object.name}': expected a finite place in the world, found NaN or infinity; export the model again`);
    const place = object.geometry.attributes.position as BufferAttribute | undefined;
    if (!place) console.warn(`lightwell: mesh '${object.name}': expected positions, found none; it is not drawn, export the model again`);
    if (!place || seen.has(place)) return;
    seen.add(place);
    if (!(place.array instanceof Float32Array) || place.array.every(Number.isFinite)) return;
    console.warn(`lightwell: mesh '${object.name}': expected finite positions, found NaN or infinity; export the model again`);
  });
}

/** A texture as linear data: numbers, not a colour. */
async function loadData(parser: GLTFParser, index: number): Promise<Texture> {
  const { json, options } = parser as unknown as { json: GltfJson; options: { ktx2Loader?: unknown } };
  const { source, extensions } = (json.textures as any[] | undefined)?.[index] ?? {};
  if (extensions?.KHR_texture_basisu && source === undefined && !options.ktx2Loader)
    fail(`textures[${index}]`, "a decoder of its KTX2 picture, found none; pass { renderer } to LightwellLoaderPlugin, or bake without --compress");
  const found: Texture | null = await parser.getDependency("texture", index);
  if (!found) fail(`textures[${index}]`, "a picture that can be decoded");
  const { width = 0, height = 0 } = (found.image ?? {}) as { width?: number; height?: number };
  if (Math.max(width, height) > LIMITS.pictureEdge || width * height > LIMITS.pictureTexels)
    fail(`textures[${index}]`, `at most ${LIMITS.pictureEdge} × 8192 texels, found ${width} × ${height}; scale it down`);
  // The loader hands the same object to every material that names it.
  const texture = found.clone();
  texture.colorSpace = NoColorSpace;
  texture.flipY = texture.premultiplyAlpha = false;
  texture.needsUpdate = true;
  return texture;
}

/** Size of the picture of a texture in the file; 0 when it is not in it. */
function encodedBytes(json: GltfJson, index: number): number {
  // `checkContainer` has seen all of these.
  const [textures, images, views] = [json.textures, json.images, json.bufferViews] as any[][];
  const { source, extensions } = textures?.[index] ?? {};
  const image = images?.[extensions?.EXT_texture_webp?.source ?? extensions?.KHR_texture_basisu?.source ?? source];
  return Number(views?.[image?.bufferView]?.byteLength ?? 0);
}

async function loadPicture(parser: GLTFParser, index: number) {
  const source = await loadData(parser, index);
  const { width, height } = source.image as { width: number; height: number };
  return { source, width, height, bytes: encodedBytes(parser.json as GltfJson, index) };
}

/** The light maps of all materials that a scene's meshes wear. */
async function readLightmaps(gltf: GLTF, parser: GLTFParser): Promise<Map<Material, Lightmap>> {
  const json = parser.json as GltfJson;
  const documents = (json.materials ?? []) as Record<string, unknown>[];
  const count = Array.isArray(json.textures) ? json.textures.length : 0;
  const lightmaps = new Map<Material, Lightmap>();
  const textures = new Map<number, Promise<Texture>>();
  const worn = new Set<Material>();
  gltf.scene.traverse((object) => {
    if (object instanceof Mesh) for (const material of [object.material].flat()) worn.add(material);
  });
  for (const material of worn) {
    const index = parser.associations.get(material)?.materials;
    const extensions = index === undefined ? undefined : documents[index]?.extensions;
    const found = readLightmap(extensions, count, `materials[${index}].${LIGHTMAP_EXTENSION}`);
    if (!found) continue;
    const texture = textures.get(found.index) ?? loadData(parser, found.index);
    textures.set(found.index, texture);
    const map = await texture;
    map.channel = found.texCoord;
    lightmaps.set(material, { ...found, map, bytes: encodedBytes(json, found.index) });
  }
  return lightmaps;
}
