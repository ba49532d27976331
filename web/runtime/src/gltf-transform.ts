/** `lightwell/gltf-transform`: keeps learned light when a file passes through glTF-Transform, which drops what it does not know. */

import {
  type Accessor,
  type Animation,
  Extension,
  ExtensionProperty,
  type IProperty,
  type Material,
  type Node,
  type Nullable,
  PropertyType,
  type ReaderContext,
  RefMap,
  type Texture,
  TextureChannel,
  TextureInfo,
  type WriterContext,
} from "@gltf-transform/core";
import { list, record } from "./checks.ts";
import { EXTENSION } from "./extension-name.ts";
import { LIGHTMAP_EXTENSION, type LightmapRecord, readLightmap } from "./lightmap.ts";

/** Extensions that name a texture's picture in place of `source`, by its type. */
const CARRIERS: Readonly<Record<string, string>> = {
  "image/webp": "EXT_texture_webp",
  "image/ktx2": "KHR_texture_basisu",
};
const MAX_ENTRIES = 1 << 12;
/** How glTF-Transform calls numbers that are neither vertices nor indices. */
const USAGE = "OTHER";

type Json = Record<string, unknown>;

interface INeuralRadiance extends IProperty {
  json: Json;
  accessors: RefMap<Accessor>;
  textures: RefMap<Texture>;
  infos: RefMap<TextureInfo>;
  nodes: RefMap<Node>;
  animations: RefMap<Animation>;
}

/**
 * The extension at the root. `getJson` is its JSON as it was read, where every `accessor` and `texture` of a buffer, the `texture` of the environment, and
 * the `node` or `animation` of a variable that moves is the name of what is referred to.
 */
export class NeuralRadianceProperty extends ExtensionProperty<INeuralRadiance> {
  static override readonly EXTENSION_NAME = EXTENSION;
  declare extensionName: typeof EXTENSION;
  declare propertyType: "NeuralRadiance";
  declare parentTypes: PropertyType[];

  protected init(): void {
    this.extensionName = EXTENSION;
    this.propertyType = "NeuralRadiance";
    this.parentTypes = [PropertyType.ROOT];
  }

  protected override getDefaults(): Nullable<INeuralRadiance> {
    const pictures = { textures: new RefMap<Texture>(), infos: new RefMap<TextureInfo>() };
    const movers = { nodes: new RefMap<Node>(), animations: new RefMap<Animation>() };
    return Object.assign(super.getDefaults() as IProperty, { json: {}, accessors: new RefMap<Accessor>(), ...pictures, ...movers });
  }

  getJson(): Json {
    return this.get("json") as Json;
  }

  setJson(json: Json): this {
    return this.set("json", json as never);
  }

  getAccessor(name: string): Accessor | null {
    return this.getRefMap("accessors", name);
  }

  setAccessor(name: string, accessor: Accessor): this {
    return this.setRefMap("accessors", name, accessor, { usage: USAGE });
  }

  getTexture(name: string): Texture | null {
    return this.getRefMap("textures", name);
  }

  /** How a texture is sampled; null when there is none of this name. */
  getTextureInfo(name: string): TextureInfo | null {
    return this.getRefMap("infos", name);
  }

  setTexture(name: string, texture: Texture, info: TextureInfo): this {
    const channels = TextureChannel.R | TextureChannel.G | TextureChannel.B;
    return this.setRefMap("textures", name, texture, { channels, isColor: false }).setRefMap("infos", name, info);
  }

  /** A node that moves. */
  getNode(name: string): Node | null {
    return this.getRefMap("nodes", name);
  }

  setNode(name: string, node: Node): this {
    return this.setRefMap("nodes", name, node);
  }

  /** An animation whose time is a variable. */
  getAnimation(name: string): Animation | null {
    return this.getRefMap("animations", name);
  }

  setAnimation(name: string, animation: Animation): this {
    return this.setRefMap("animations", name, animation);
  }
}

/**
 * Reads and writes `LIGHTWELL_neural_radiance`.
 *
 * ```ts
 * const io = new NodeIO().registerExtensions([NeuralRadiance, Lightmap]);
 * await io.write("smaller.glb", await io.read("scene.glb"));
 * ```
 */
export class NeuralRadiance extends Extension {
  static override readonly EXTENSION_NAME = EXTENSION;
  override readonly extensionName = EXTENSION;

  create(): NeuralRadianceProperty {
    return new NeuralRadianceProperty(this.document.getGraph());
  }

  override read(context: ReaderContext): this {
    const found = (context.jsonDoc.json.extensions as Json | undefined)?.[EXTENSION];
    if (found === undefined) return this;
    const property = this.create();
    const json = mapBuffers(structuredClone(record(found, EXTENSION)), (buffer, name) => {
      if (buffer.texture !== undefined) {
        const { texture, info } = readTexture(context, new TextureInfo(this.document.getGraph()), buffer.texture as number);
        property.setTexture(name, texture, info);
        return { texture: name };
      }
      const accessor = context.accessors[buffer.accessor as number];
      if (!accessor) throw new Error(`${EXTENSION}: ${name}: expected an accessor of the file`);
      property.setAccessor(name, unpadded(context, accessor, buffer.accessor as number));
      return { accessor: name };
    });
    mapMovers(json, (kind, index, name) => {
      const [node, animation] = kind === "node" ? [context.nodes[index as number]] : [undefined, context.animations[index as number]];
      if (node) property.setNode(name, node);
      else if (animation) property.setAnimation(name, animation);
      else throw new Error(`${EXTENSION}: ${name}: expected the ${kind} of this number in the file`);
      return name;
    });
    this.document.getRoot().setExtension(EXTENSION, property.setJson(json));
    return this;
  }

  override write(context: WriterContext): this {
    const property = this.document.getRoot().getExtension<NeuralRadianceProperty>(EXTENSION);
    if (!property) return this;
    const json = mapBuffers(structuredClone(property.getJson()), (_buffer, name) => {
      const [accessor, texture] = [property.getAccessor(name), property.getTexture(name)];
      if (texture) return { texture: writeTexture(context, texture, property.getTextureInfo(name)!).index };
      if (!accessor) throw new Error(`${EXTENSION}: ${name}: expected its accessor or texture`);
      return { accessor: context.accessorIndexMap.get(accessor) };
    });
    mapMovers(json, (kind, _name, name) => {
      const [node, animation] = [property.getNode(name), property.getAnimation(name)];
      const index = node ? context.nodeIndexMap.get(node) : animation ? context.animationIndexMap.get(animation) : undefined;
      if (index === undefined) throw new Error(`${EXTENSION}: ${name}: expected its ${kind}, which was removed; keep it, or bake without this variable`);
      return index;
    });
    const { extensions = {} } = context.jsonDoc.json;
    context.jsonDoc.json.extensions = { ...extensions, [EXTENSION]: json };
    return this;
  }
}

/** An accessor whose elements EXT_meshopt_compression has padded to four bytes, as only its own extension says. */
function unpadded(context: ReaderContext, accessor: Accessor, index: number): Accessor {
  const { accessors, bufferViews } = context.jsonDoc.json;
  const { bufferView = -1, byteOffset = 0, count } = accessors![index]!;
  const stride = (bufferViews?.[bufferView]?.extensions?.EXT_meshopt_compression as { byteStride?: number } | undefined)?.byteStride;
  const array = accessor.getArray();
  const view = context.bufferViews[bufferView];
  if (!array || !view || !stride || stride <= array.BYTES_PER_ELEMENT || bufferViews?.[bufferView]?.byteStride) return accessor;
  const step = stride / array.BYTES_PER_ELEMENT;
  const Kind = array.constructor as new (buffer: ArrayBufferLike) => typeof array;
  const all = new Kind(view.slice(byteOffset, byteOffset + count * stride).buffer);
  return accessor.setArray(all.filter((_: number, i: number) => i % step === 0) as typeof array);
}

/** Changes the references of every buffer, and that of the environment; `name` is unique in the file. */
function mapBuffers(json: Json, change: (buffer: Json, name: string) => Json): Json {
  for (const table of ["fields", "probes"]) {
    for (const [i, field] of list(json[table] ?? [], `${EXTENSION}.${table}`, MAX_ENTRIES).entries()) {
      const where = `${EXTENSION}.${table}[${i}]`;
      const graph = record(record(field, where).graph, `${where}.graph`);
      for (const [name, value] of Object.entries(record(graph.buffers ?? {}, `${where}.graph.buffers`))) {
        const buffer = record(value, `${where}.graph.buffers.${name}`);
        Object.assign(buffer, change(buffer, `${table === "fields" ? "" : "probes."}${i}.${name}`));
      }
    }
  }
  if (json.environment === undefined) return json;
  const environment = record(json.environment, `${EXTENSION}.environment`);
  if (environment.texture !== undefined) Object.assign(environment, change(environment, "environment"));
  return json;
}

/** Changes the references of the variables that move, to a node or an animation; `name` is unique in the file. */
function mapMovers(json: Json, change: (kind: "node" | "animation", value: unknown, name: string) => unknown): void {
  for (const [i, value] of list(json.variables ?? [], `${EXTENSION}.variables`, MAX_ENTRIES).entries()) {
    const variable = record(value, `${EXTENSION}.variables[${i}]`);
    const kind = variable.kind === "node" ? "node" : variable.kind === "clip" ? "animation" : null;
    if (kind) variable[kind] = change(kind, variable[kind], `variables[${i}].${kind}`);
  }
}

/** The picture and the sampling of a texture, whoever knows its format. */
function readTexture(context: ReaderContext, info: TextureInfo, index: number): { texture: Texture; info: TextureInfo } {
  const definition = context.jsonDoc.json.textures?.[index];
  const carried = Object.values(CARRIERS).map((name) => (definition?.extensions?.[name] as { source?: number } | undefined)?.source);
  const texture = context.textures[carried.find((source) => source !== undefined) ?? definition?.source ?? -1];
  if (!texture) throw new Error(`${EXTENSION}: expected textures[${index}] with a picture`);
  context.setTextureInfo(info, { index });
  return { texture, info };
}

/** Refers to a texture; a WebP or KTX2 picture by the extension for it, which may have been written before this one. */
function writeTexture(context: WriterContext, texture: Texture, info: TextureInfo): { index: number; texCoord?: number } {
  const definition = context.createTextureInfoDef(texture, info);
  const { json } = context.jsonDoc;
  const entry = json.textures![definition.index]!;
  const carrier = CARRIERS[texture.getMimeType()];
  if (carrier && entry.source !== undefined) {
    entry.extensions = { ...entry.extensions, [carrier]: { source: entry.source } };
    delete entry.source;
    json.extensionsUsed = [...new Set([...(json.extensionsUsed ?? []), carrier])];
  }
  return definition;
}

interface ILightmap extends IProperty {
  intensity: number;
  lightmapTexture: Texture;
  lightmapTextureInfo: TextureInfo;
}

/** An ordinary light map of a material. */
export class LightmapProperty extends ExtensionProperty<ILightmap> {
  static override readonly EXTENSION_NAME = LIGHTMAP_EXTENSION;
  declare extensionName: typeof LIGHTMAP_EXTENSION;
  declare propertyType: "Lightmap";
  declare parentTypes: PropertyType[];

  protected init(): void {
    this.extensionName = LIGHTMAP_EXTENSION;
    this.propertyType = "Lightmap";
    this.parentTypes = [PropertyType.MATERIAL];
  }

  protected override getDefaults(): Nullable<ILightmap> {
    const info = new TextureInfo(this.graph, "lightmapTextureInfo").setTexCoord(1);
    return Object.assign(super.getDefaults() as IProperty, {
      intensity: 1,
      lightmapTexture: null,
      lightmapTextureInfo: info,
    });
  }

  getIntensity(): number {
    return this.get("intensity");
  }

  setIntensity(intensity: number): this {
    return this.set("intensity", intensity);
  }

  getLightmapTexture(): Texture | null {
    return this.getRef("lightmapTexture");
  }

  setLightmapTexture(texture: Texture | null): this {
    const channels = TextureChannel.R | TextureChannel.G | TextureChannel.B;
    return this.setRef("lightmapTexture", texture, { channels, isColor: false });
  }

  getLightmapTextureInfo(): TextureInfo | null {
    return this.getRef("lightmapTexture") ? this.getRef("lightmapTextureInfo") : null;
  }
}

/** Reads and writes `MOZ_lightmap`, the fallback of a neural light map. */
export class Lightmap extends Extension {
  static override readonly EXTENSION_NAME = LIGHTMAP_EXTENSION;
  override readonly extensionName = LIGHTMAP_EXTENSION;

  createLightmap(): LightmapProperty {
    return new LightmapProperty(this.document.getGraph());
  }

  override read(context: ReaderContext): this {
    const { materials = [], textures = [] } = context.jsonDoc.json;
    for (const [i, material] of materials.entries()) {
      const found: LightmapRecord | null = readLightmap(
        material.extensions,
        textures.length,
        `materials[${i}].extensions.${LIGHTMAP_EXTENSION}`,
      );
      if (!found) continue;
      const property = this.createLightmap().setIntensity(found.intensity);
      context.materials[i]!.setExtension(LIGHTMAP_EXTENSION, property);
      const info = new TextureInfo(this.document.getGraph());
      const { texture } = readTexture(context, info, found.index);
      property.setLightmapTexture(texture);
      const kept = property.getLightmapTextureInfo()!;
      context.setTextureInfo(kept, { index: found.index, texCoord: found.texCoord });
    }
    return this;
  }

  override write(context: WriterContext): this {
    for (const material of this.document.getRoot().listMaterials() as Material[]) {
      const property = material.getExtension<LightmapProperty>(LIGHTMAP_EXTENSION);
      const texture = property?.getLightmapTexture();
      if (!property || !texture) continue;
      const definition = context.jsonDoc.json.materials![context.materialIndexMap.get(material)!]!;
      const map = writeTexture(context, texture, property.getLightmapTextureInfo()!);
      definition.extensions = {
        ...definition.extensions,
        [LIGHTMAP_EXTENSION]: { ...map, texCoord: map.texCoord ?? 0, intensity: property.getIntensity() },
      };
    }
    return this;
  }
}
