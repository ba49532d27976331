/** The form of a glTF 2.0 document, as far as a loader reads it: types, ranges, and indices into tables that exist. */

import { fail } from "./checks.ts";
import { LIMITS } from "./limits.ts";
import { dictionary, each, flag, members, numbers, oneOf, range, type Rule, uri, whole, words } from "./rules.ts";

type Json = Record<string, unknown>;

/** The tables of a document. */
const TABLES = [
  "accessors",
  "animations",
  "buffers",
  "bufferViews",
  "cameras",
  "images",
  "materials",
  "meshes",
  "nodes",
  "samplers",
  "scenes",
  "skins",
  "textures",
] as const;
export type TableName = (typeof TABLES)[number];

const MAX_BYTES = 2 ** 32;
const name = { name: words() };
const bytes = whole(0, MAX_BYTES);
/** Largest factor, distance or intensity that single precision keeps apart from infinity in a product of a few. */
const amount = range(-1e12, 1e12);
/** A number of OpenGL's, which a loader replaces when it does not know it. */
const enumerated = whole(0, 1 << 20);

/** Throws a `FormatError` unless everything that a loader reads is of its type and every index points at something. */
export function checkForm(json: Json): void {
  for (const table of TABLES) each(() => {}, 0, LIMITS.entries)(json[table] ?? [], table);
  const rules = documentRules((table) => (value, where) => {
    const { length } = (json[table] ?? []) as unknown[];
    if (length === 0) fail(where, `no index: the document has no ${table}`);
    whole(0, length - 1)(value, where);
  });
  members({ asset: members({ version: words(), generator: words(), minVersion: words() }, "version") }, "asset")(json, "document");
  members({ extensionsUsed: each(words(), 0, 256), extensionsRequired: each(words(), 0, 256) })(json, "document");
  for (const table of TABLES)
    ((json[table] ?? []) as unknown[]).forEach((entry, i) => rules[table](entry, `${table}[${i}]`));
  if (json.scene !== undefined) whole(0, Math.max(((json.scenes ?? []) as unknown[]).length - 1, 0))(json.scene, "scene");
  const lights = each(LIGHT, 0, LIMITS.entries);
  const extensions = { KHR_lights_punctual: members({ lights }), KHR_materials_variants: members({}) };
  if (json.extensions !== undefined) members(extensions)(json.extensions, "extensions");
}

const LIGHT = members({
  ...name,
  type: words("point", "spot", "directional"),
  color: numbers(3, 0, 1e12),
  intensity: amount,
  range: amount,
  spot: members({ innerConeAngle: amount, outerConeAngle: amount }),
});

const ACCESSOR_TYPES = ["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"] as const;
const COMPONENT_TYPES = [5120, 5121, 5122, 5123, 5125, 5126] as const;

function documentRules(index: (table: TableName) => Rule): Record<TableName, Rule> {
  const view = index("bufferViews");
  const texture = members(
    {
      index: index("textures"),
      texCoord: whole(0, 3),
      scale: amount,
      strength: amount,
      extensions: members({
        KHR_texture_transform: members({ offset: numbers(2), scale: numbers(2), rotation: range(), texCoord: whole(0, 3) }),
      }),
    },
    "index",
  );
  return {
    accessors: members(
      {
        ...name,
        bufferView: view,
        byteOffset: bytes,
        componentType: oneOf(...COMPONENT_TYPES),
        count: whole(1, LIMITS.elements),
        type: words(...ACCESSOR_TYPES),
        normalized: flag,
        min: each(range(), 1, 16),
        max: each(range(), 1, 16),
        sparse: sparseRule(view),
      },
      "componentType",
      "count",
      "type",
    ),
    buffers: members({ ...name, byteLength: whole(1, MAX_BYTES), uri }, "byteLength"),
    bufferViews: viewRule(index),
    images: members({ ...name, uri, bufferView: view, mimeType: words() }),
    samplers: members({
      magFilter: enumerated,
      minFilter: enumerated,
      wrapS: enumerated,
      wrapT: enumerated,
    }),
    textures: textureRule(index),
    materials: materialRule(texture),
    meshes: meshRule(index),
    nodes: nodeRule(index),
    scenes: members({ ...name, nodes: each(index("nodes"), 0, LIMITS.entries) }),
    skins: members(
      { ...name, inverseBindMatrices: index("accessors"), skeleton: index("nodes"), joints: each(index("nodes"), 1, LIMITS.entries) },
      "joints",
    ),
    animations: animationRule(index),
    cameras: cameraRule(),
  };
}

function sparseRule(view: Rule): Rule {
  const indices = members({ bufferView: view, byteOffset: bytes, componentType: oneOf(5121, 5123, 5125) }, "bufferView", "componentType");
  const values = members({ bufferView: view, byteOffset: bytes }, "bufferView");
  return members({ count: whole(1, LIMITS.elements), indices, values }, "count", "indices", "values");
}

function viewRule(index: (table: TableName) => Rule): Rule {
  const place = { buffer: index("buffers"), byteOffset: bytes, byteLength: whole(1, MAX_BYTES) };
  const compressed = members(
    {
      ...place,
      byteStride: whole(1, 256),
      count: whole(1, LIMITS.elements),
      mode: words("ATTRIBUTES", "TRIANGLES", "INDICES"),
      filter: words("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR"),
    },
    "buffer",
    "byteLength",
    "byteStride",
    "count",
    "mode",
  );
  const extensions = members({ EXT_meshopt_compression: compressed, KHR_meshopt_compression: compressed });
  return members({ ...name, ...place, byteStride: whole(1, 252), extensions }, "buffer", "byteLength");
}

function textureRule(index: (table: TableName) => Rule): Rule {
  const carried = members({ source: index("images") }, "source");
  const extensions = members({ EXT_texture_webp: carried, EXT_texture_avif: carried, KHR_texture_basisu: carried });
  return members({ ...name, source: index("images"), sampler: index("samplers"), extensions });
}

/** A material extension: textures by name, and numbers or colours. */
function surfaceRule(texture: Rule): Rule {
  const colour = each(amount, 1, 4);
  return (value, where) => {
    members({})(value, where);
    for (const [key, entry] of Object.entries(value as Json)) {
      const at = `${where}.${key.slice(0, 40)}`;
      if (key.endsWith("Texture")) texture(entry, at);
      else if (Array.isArray(entry)) colour(entry, at);
      else if (typeof entry === "number") amount(entry, at);
      else if (key.endsWith("Factor") || key.endsWith("Color") || key.endsWith("Strength")) fail(at, "a number or a colour");
    }
  };
}

function materialRule(texture: Rule): Rule {
  const extension = surfaceRule(texture);
  return members({
    ...name,
    pbrMetallicRoughness: members({
      baseColorFactor: numbers(4, 0, 1e12),
      baseColorTexture: texture,
      metallicFactor: amount,
      roughnessFactor: amount,
      metallicRoughnessTexture: texture,
    }),
    normalTexture: texture,
    occlusionTexture: texture,
    emissiveTexture: texture,
    emissiveFactor: numbers(3, 0, 1e12),
    alphaMode: words(),
    alphaCutoff: range(0, 1e12),
    doubleSided: flag,
    extensions: (value, where) =>
      dictionary((entry, at) => {
        if (at.includes(".KHR_materials_")) extension(entry, at);
      }, 0, 256)(value, where),
  });
}

function meshRule(index: (table: TableName) => Rule): Rule {
  const attributes = dictionary(index("accessors"), 0, 64);
  const draco = members({ bufferView: index("bufferViews"), attributes: dictionary(whole(0, 1 << 16), 0, 64) }, "bufferView", "attributes");
  const primitive = members(
    {
      attributes: dictionary(index("accessors"), 1, 64),
      indices: index("accessors"),
      material: index("materials"),
      mode: whole(0, 6),
      targets: each(attributes, 0, 1024),
      extensions: members({ KHR_draco_mesh_compression: draco }),
    },
    "attributes",
  );
  return members({ ...name, primitives: each(primitive, 1, LIMITS.entries), weights: each(amount, 0, 1024) }, "primitives");
}

function nodeRule(index: (table: TableName) => Rule): Rule {
  const light = members({ light: whole(0, LIMITS.entries) }, "light");
  const instanced = members({ attributes: dictionary(index("accessors"), 0, 64) }, "attributes");
  return members({
    ...name,
    mesh: index("meshes"),
    camera: index("cameras"),
    skin: index("skins"),
    children: each(index("nodes"), 0, LIMITS.entries),
    matrix: numbers(16, -1e12, 1e12),
    translation: numbers(3, -1e12, 1e12),
    rotation: numbers(4, -2, 2),
    scale: numbers(3, -1e12, 1e12),
    weights: each(amount, 0, 1024),
    extensions: members({ KHR_lights_punctual: light, EXT_mesh_gpu_instancing: instanced }),
  });
}

function animationRule(index: (table: TableName) => Rule): Rule {
  const sampler = members(
    { input: index("accessors"), output: index("accessors"), interpolation: words("LINEAR", "STEP", "CUBICSPLINE") },
    "input",
    "output",
  );
  const target = members({ node: index("nodes"), path: words("translation", "rotation", "scale", "weights", "pointer") }, "path");
  const channel = members({ sampler: whole(0, LIMITS.entries), target }, "sampler", "target");
  return (value, where) => {
    const lists = { samplers: each(sampler, 0, LIMITS.entries), channels: each(channel, 0, LIMITS.entries) };
    members({ ...name, ...lists }, "samplers", "channels")(value, where);
    const { samplers, channels } = value as { samplers: unknown[]; channels: { sampler: number }[] };
    channels.forEach((entry, i) => whole(0, samplers.length - 1)(entry.sampler, `${where}.channels[${i}].sampler`));
  };
}

function cameraRule(): Rule {
  const perspective = members({ yfov: range(1e-6, 6.3), znear: range(1e-12, 1e12), zfar: range(0, 1e12), aspectRatio: range(1e-6, 1e6) }, "yfov", "znear");
  const orthographic = members({ xmag: amount, ymag: amount, znear: range(0, 1e12), zfar: range(0, 1e12) }, "xmag", "ymag", "znear", "zfar");
  return (value, where) => {
    members({ ...name, type: words("perspective", "orthographic"), perspective, orthographic }, "type")(value, where);
    const entry = value as Json;
    if (entry[entry.type as string] === undefined) fail(`${where}.${entry.type as string}`, "an object");
  };
}
