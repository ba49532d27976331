/** three.js GLTFLoader plugin that reads the learned light of a glTF file. */

import { type Material, Mesh, NoColorSpace, type Texture } from "three";
import type { GLTF, GLTFLoaderPlugin, GLTFParser } from "three/addons/loaders/GLTFLoader.js";
import { FormatError } from "./checks.ts";
import { checkContainer, type GltfJson } from "./container.ts";
import { EXTENSION, type NeuralRadiance, readExtension, type Sources } from "./extension.ts";
import { LIGHTMAP_EXTENSION, type LightmapRecord, readLightmap } from "./lightmap.ts";

/** An ordinary light map of a material, as a texture. */
export interface Lightmap extends LightmapRecord {
  readonly map: Texture;
  /** Size of the encoded picture; 0 when unknown. */
  readonly bytes: number;
}

/** What the plugin leaves on `gltf.userData.lightwell`. */
export interface LoadedLight extends NeuralRadiance {
  /** Ordinary light maps (MOZ_lightmap), which the learned light takes the place of. */
  readonly lightmaps: ReadonlyMap<Material, Lightmap>;
}

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

  constructor(parser: GLTFParser) {
    this.parser = parser;
  }

  /** Rejects a document that a loader could not read safely, before anything of it is loaded. */
  async beforeRoot(): Promise<void> {
    checkContainer(this.parser.json as GltfJson);
  }

  async afterRoot(gltf: GLTF): Promise<void> {
    const { parser } = this;
    const sources: Sources = {
      bufferView: (index) => parser.getDependency("bufferView", index) as Promise<ArrayBuffer>,
      texture: (index) => loadPicture(parser, index),
    };
    const radiance = await readExtension(parser.json as GltfJson, sources);
    const lightmaps = await readLightmaps(gltf, parser);
    if (radiance || lightmaps.size > 0) {
      const loaded: LoadedLight = { ...(radiance ?? { variables: [], fields: [] }), lightmaps };
      gltf.userData.lightwell = loaded;
    }
  }
}

/** The learned light that `LightwellLoaderPlugin` found in a file; an empty one when there is none. */
export function learnedLight(gltf: GLTF): LoadedLight {
  const found = gltf.userData.lightwell as LoadedLight | undefined;
  return found ?? { variables: [], fields: [], lightmaps: new Map() };
}

/** A texture as linear data: numbers, not a colour. */
async function loadData(parser: GLTFParser, index: number): Promise<Texture> {
  const found: Texture | null = await parser.getDependency("texture", index);
  if (!found) throw new FormatError(`textures[${index}]: expected a picture`);
  // The loader hands the same object to every material that names it.
  const texture = found.clone();
  texture.colorSpace = NoColorSpace;
  texture.flipY = texture.premultiplyAlpha = false;
  texture.needsUpdate = true;
  return texture;
}

/** Size of the picture of a texture in the file; 0 when it is not in it. */
function encodedBytes(json: GltfJson, index: number): number {
  const [textures, images, views] = [json.textures, json.images, json.bufferViews] as any[][];
  const { source, extensions } = textures?.[index] ?? {};
  const image = images?.[extensions?.EXT_texture_webp?.source ?? source];
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
