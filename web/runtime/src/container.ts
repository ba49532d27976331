/** Checks of a glTF document that a loader would otherwise answer with a hang, a crash or an error of its own. */

import { fail, list, record } from "./checks.ts";
import { checkForm } from "./document-rules.ts";
import { LIMITS } from "./limits.ts";
import { pictureSize } from "./picture-size.ts";

/** The parts of a glTF document that this package reads; everything in it is untrusted. */
export type GltfJson = Record<string, unknown>;

interface Accessor {
  readonly bufferView?: number;
  readonly byteOffset?: number;
  readonly componentType: number;
  readonly count: number;
  readonly type: string;
  readonly sparse?: Sparse;
}

interface Sparse {
  readonly count: number;
  readonly indices: { readonly bufferView: number; readonly byteOffset?: number; readonly componentType: number };
  readonly values: { readonly bufferView: number; readonly byteOffset?: number };
}

interface View {
  readonly buffer: number;
  readonly byteOffset?: number;
  readonly byteLength: number;
  readonly byteStride?: number;
  readonly extensions?: Readonly<Record<string, { byteStride: number; count: number } & View>>;
}

const COMPONENT_BYTES: Readonly<Record<number, number>> = { 5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4 };
const COMPONENTS: Readonly<Record<string, number>> = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4, MAT2: 4, MAT3: 9, MAT4: 16 };
const COMPRESSORS = ["EXT_meshopt_compression", "KHR_meshopt_compression"] as const;

/**
 * Throws a `FormatError` when a document cannot be loaded safely: wrong types, indices and ranges past their ends, counts and
 * pictures beyond all use, nodes in circles. `binary` is the binary chunk of a GLB, where there is one.
 */
export function checkContainer(json: GltfJson, binary: Uint8Array | null = null): void {
  checkForm(json);
  checkViews(json, binary);
  checkAccessors(json);
  checkPictures(json, binary);
  checkAttributes(json);
  checkTree(json);
  checkDrawn(json);
}

const tableOf = <T>(json: GltfJson, name: string) => (json[name] ?? []) as readonly T[];

/** Every buffer view, compressed or not, lies inside its buffer, and the first buffer inside of the binary chunk. */
function checkViews(json: GltfJson, binary: Uint8Array | null): void {
  const buffers = tableOf<{ byteLength: number; uri?: string }>(json, "buffers");
  buffers.forEach(({ uri, byteLength }, i) => {
    if (i === 0 && uri === undefined && binary && byteLength > binary.length)
      fail(`buffers[${i}].byteLength`, `at most the ${binary.length} bytes of the binary chunk, found ${byteLength}`);
  });
  const inside = ({ buffer, byteOffset = 0, byteLength }: View, where: string) => {
    const size = buffers[buffer]!.byteLength;
    if (byteOffset + byteLength > size) fail(where, `bytes inside of its buffer of ${size}, found ${byteOffset + byteLength}`);
  };
  let decoded = 0;
  tableOf<View>(json, "bufferViews").forEach((view, i) => {
    inside(view, `bufferViews[${i}]`);
    for (const name of COMPRESSORS) {
      const packed = view.extensions?.[name];
      if (!packed) continue;
      const where = `bufferViews[${i}].extensions.${name}`;
      inside(packed, where);
      decoded += packed.count * packed.byteStride;
      if (packed.count * packed.byteStride > view.byteLength) fail(where, `a count that fits into ${view.byteLength} bytes`);
      if (decoded > LIMITS.bytes) fail(where, `at most ${LIMITS.bytes} bytes decoded in all`);
    }
  });
}

/** Every accessor stays inside its buffer view, and all together stand for no absurd number of bytes. */
function checkAccessors(json: GltfJson): void {
  const views = tableOf<View>(json, "bufferViews");
  const unpacked = unpackedAccessors(json);
  let [total, zeros] = [0, 0];
  const inside = (view: number, offset: number, count: number, size: number, stride: number, where: string) => {
    const { byteLength } = views[view]!;
    const end = offset + (count - 1) * stride + size;
    if (end > byteLength) fail(where, `${end} bytes, found ${byteLength} in bufferViews[${view}]`);
  };
  tableOf<Accessor>(json, "accessors").forEach((accessor, i) => {
    const { bufferView, byteOffset = 0, componentType, count, type, sparse } = accessor;
    const where = `accessors[${i}]`;
    const bytes = COMPONENT_BYTES[componentType]!;
    const size = bytes * COMPONENTS[type]!;
    total += size * count;
    if (total > LIMITS.bytes) fail(where, `at most ${LIMITS.bytes} bytes in all accessors up to here`);
    if (byteOffset % bytes) fail(`${where}.byteOffset`, `a multiple of ${bytes}`);
    if (bufferView === undefined && !unpacked.has(i)) zeros += size * count;
    if (zeros > LIMITS.zeros) fail(where, `a bufferView, or at most ${LIMITS.zeros} bytes of zeros in all accessors up to here`);
    if (bufferView !== undefined) inside(bufferView, byteOffset, count, size, strideOf(views[bufferView]!, size, bytes, where), where);
    if (!sparse) return;
    if (sparse.count > count) fail(`${where}.sparse.count`, `at most ${count}`);
    const { indices, values } = sparse;
    const indexBytes = COMPONENT_BYTES[indices.componentType]!;
    const starts = [indices.byteOffset ?? 0, values.byteOffset ?? 0] as const;
    if (starts[0] % indexBytes || starts[1] % bytes) fail(`${where}.sparse`, "offsets that are multiples of their component's size");
    inside(indices.bufferView, starts[0], sparse.count, indexBytes, indexBytes, `${where}.sparse.indices`);
    inside(values.bufferView, starts[1], sparse.count, size, size, `${where}.sparse.values`);
  });
}

/** Accessors that a decompressor fills. */
function unpackedAccessors(json: GltfJson): Set<number> {
  const found = new Set<number>();
  for (const { primitives } of tableOf<{ primitives: any[] }>(json, "meshes")) {
    for (const { attributes, indices, extensions } of primitives) {
      if (!extensions?.KHR_draco_mesh_compression) continue;
      for (const index of [...Object.values<number>(attributes), indices]) if (index !== undefined) found.add(index);
    }
  }
  return found;
}

function strideOf(view: View, size: number, bytes: number, where: string): number {
  const stride = view.byteStride ?? size;
  if (stride % bytes || stride < size) fail(where, `a byteStride of at least ${size}, a multiple of ${bytes}, found ${stride}`);
  return stride;
}

/** Pictures in the file are of a size that a page can hold; those elsewhere are measured when they are there. */
function checkPictures(json: GltfJson, binary: Uint8Array | null): void {
  const views = tableOf<View>(json, "bufferViews");
  let texels = 0;
  tableOf<{ bufferView?: number; uri?: string }>(json, "images").forEach(({ bufferView, uri }, i) => {
    const where = `images[${i}]`;
    if ((bufferView === undefined) === (uri === undefined)) fail(where, "one of bufferView and uri");
    const view = bufferView === undefined ? undefined : views[bufferView]!;
    const start = view?.byteOffset ?? 0;
    const inChunk = binary && view?.buffer === 0;
    const bytes = inChunk ? binary.subarray(start, start + view.byteLength) : dataOf(uri);
    const size = bytes && pictureSize(bytes);
    if (!size) return;
    const edge = Math.max(size.width, size.height);
    texels += size.width * size.height;
    if (edge > LIMITS.pictureEdge || size.width * size.height > LIMITS.pictureTexels)
      fail(where, `at most ${LIMITS.pictureEdge} × 8192 texels, found ${size.width} × ${size.height}; scale it down`);
    if (texels > LIMITS.texels) fail(where, `at most ${LIMITS.texels} texels in all pictures up to here; scale them down`);
  });
}

/** Characters of base64 in which the head of a picture lies. */
const HEAD_CHARACTERS = 1 << 16;

/** The first bytes of a base64 data URI. */
function dataOf(uri: string | undefined): Uint8Array | null {
  const comma = uri?.startsWith("data:") ? uri.slice(0, 256).indexOf(",") : -1;
  if (!uri || comma < 0 || !uri.slice(0, comma).endsWith(";base64")) return null;
  try {
    return Uint8Array.from(atob(uri.slice(comma + 1, comma + 1 + HEAD_CHARACTERS)), (c) => c.charCodeAt(0));
  } catch {
    return fail("images", "base64 in a data URI");
  }
}

/** The node hierarchy is a forest of limited depth: a cycle would make a loader wait for itself for ever. */
function checkTree(json: GltfJson): void {
  const nodes = tableOf<{ children?: number[] }>(json, "nodes");
  if (nodes.length > LIMITS.nodes) fail("nodes", `at most ${LIMITS.nodes} nodes`);
  const parent = new Int32Array(nodes.length).fill(-1);
  nodes.forEach(({ children = [] }, i) => {
    children.forEach((child, k) => {
      if (parent[child] !== -1) fail(`nodes[${i}].children[${k}]`, "a node without another parent");
      parent[child] = i;
    });
  });
  const level = new Int32Array(nodes.length);
  for (let i = 0; i < nodes.length; i++) {
    const path: number[] = [];
    let at = i;
    for (; at !== -1 && level[at] === 0; at = parent[at]!) {
      if (path.length > nodes.length) fail(`nodes[${i}]`, "a node that is not its own ancestor");
      path.push(at);
    }
    let depth = at === -1 ? 0 : level[at]!;
    for (const node of path.reverse()) level[node] = ++depth;
    if (depth > LIMITS.depth) fail(`nodes[${i}]`, `a tree of at most ${LIMITS.depth} levels; merge empty nodes`);
  }
}

/** Attributes of vertices and instances, without the number at their end, and the types that they may have. */
const ATTRIBUTE_TYPES: Readonly<Record<string, readonly string[]>> = {
  POSITION: ["VEC3"],
  NORMAL: ["VEC3"],
  TANGENT: ["VEC4", "VEC3"],
  TEXCOORD: ["VEC2"],
  COLOR: ["VEC3", "VEC4"],
  JOINTS: ["VEC4"],
  WEIGHTS: ["VEC4"],
  TRANSLATION: ["VEC3"],
  ROTATION: ["VEC4"],
  SCALE: ["VEC3"],
};

type Attributes = Readonly<Record<string, number>>;

/** Accessors have the types of what reads them: a vector that is too short is filled up with NaN. Morph targets are few enough for a GPU. */
function checkAttributes(json: GltfJson): void {
  const accessors = tableOf<Accessor>(json, "accessors");
  let morphs = 0;
  const check = (attributes: Attributes | undefined, where: string, count?: number) => {
    for (const [name, index] of Object.entries(attributes ?? {})) {
      const types = ATTRIBUTE_TYPES[name.replace(/_\d+$/, "")];
      const found = accessors[index]!;
      if (types && !types.includes(found.type)) fail(`${where}.${name}`, `an accessor of type ${types.join(" or ")}, found ${found.type}`);
      if (count !== undefined && found.count < count) fail(`${where}.${name}`, `${count} elements, as the others have, found ${found.count}`);
    }
  };
  tableOf<{ primitives: { attributes: Attributes; indices?: number; targets?: Attributes[] }[] }>(json, "meshes").forEach(({ primitives }, i) => {
    primitives.forEach(({ attributes, indices, targets = [] }, k) => {
      const where = `meshes[${i}].primitives[${k}]`;
      const count = attributes.POSITION === undefined ? undefined : accessors[attributes.POSITION]?.count;
      for (const some of [attributes, ...targets]) check(some, where, count);
      // Four floats of a vertex for every target, for its place, for normals and for colours, however often they are the same accessor.
      const names = targets.flatMap((target) => Object.keys(target));
      morphs += 16 * (count ?? 0) * targets.length * (names.includes("COLOR_0") ? 3 : names.includes("NORMAL") ? 2 : 1);
      if (morphs > LIMITS.morphs) fail(`${where}.targets`, `at most ${LIMITS.morphs} bytes of morph targets up to here, found ${morphs}; remove some`);
      if (indices !== undefined && accessors[indices]!.type !== "SCALAR") fail(`${where}.indices`, "an accessor of type SCALAR");
    });
  });
  tableOf<any>(json, "nodes").forEach((node, i) => {
    const instances: Attributes | undefined = node.extensions?.EXT_mesh_gpu_instancing?.attributes;
    const [first] = Object.values(instances ?? {});
    check(instances, `nodes[${i}]`, first === undefined ? undefined : accessors[first]!.count);
  });
}

/** What is drawn: a mesh counts as often as nodes place it. */
function checkDrawn(json: GltfJson): void {
  const accessors = tableOf<Accessor>(json, "accessors");
  const meshes = tableOf<{ primitives: { attributes: Record<string, number>; indices?: number }[] }>(json, "meshes").map(({ primitives }) => {
    const sum = { vertices: 0, indices: 0 };
    for (const { attributes, indices } of primitives) {
      const vertices = attributes.POSITION === undefined ? 0 : accessors[attributes.POSITION]!.count;
      sum.vertices += vertices;
      sum.indices += indices === undefined ? vertices : accessors[indices]!.count;
    }
    return sum;
  });
  const drawn = { vertices: 0, indices: 0 };
  tableOf<any>(json, "nodes").forEach((node, i) => {
    const mesh = meshes[node.mesh];
    if (!mesh) return;
    const copies = instancesOf(node.extensions?.EXT_mesh_gpu_instancing?.attributes, accessors);
    for (const kind of ["vertices", "indices"] as const) {
      drawn[kind] += mesh[kind] * copies;
      if (drawn[kind] > LIMITS[kind]) fail(`nodes[${i}]`, `at most ${LIMITS[kind]} ${kind} drawn up to here, instances included`);
    }
  });
}

function instancesOf(attributes: Record<string, number> | undefined, accessors: readonly Accessor[]): number {
  return Math.max(1, ...Object.values(attributes ?? {}).map((index) => accessors[index]!.count));
}

const MAGIC = 0x46546c67;
const JSON_CHUNK = 0x4e4f534a;
const BINARY_CHUNK = 0x004e4942;
/** Bytes of a GLB before its JSON. */
const HEAD = 20;
/** Longest JSON, bytes. */
const MAX_JSON = 1 << 28;

/** The document and the binary chunk of a GLB; throws a `FormatError` for anything else. */
export function readContainer(bytes: Uint8Array): { json: GltfJson; binary: Uint8Array | null } {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.length < HEAD || view.getUint32(0, true) !== MAGIC) fail("the file", "a binary glTF (.glb)");
  const [version, length, size, kind] = [4, 8, 12, 16].map((at) => view.getUint32(at, true)) as [number, number, number, number];
  if (version !== 2) fail("the file", `glTF version 2, found ${version}`);
  if (length > bytes.length || HEAD + size > length) fail("the file", "a whole file: it is cut short; download or bake it again");
  if (kind !== JSON_CHUNK || size > MAX_JSON) fail("the file", "JSON in its first chunk");
  const json = parse(bytes.subarray(HEAD, HEAD + size));
  const at = HEAD + size;
  if (at + 8 > length) return { json, binary: null };
  const chunk = view.getUint32(at, true);
  if (at % 4) fail("the file", "chunks of a multiple of 4 bytes");
  if (view.getUint32(at + 4, true) !== BINARY_CHUNK) fail("the file", "a binary chunk after its JSON");
  if (at + 8 + chunk > length) fail("the file", "a whole file: it is cut short; download or bake it again");
  return { json, binary: bytes.subarray(at + 8, at + 8 + chunk) };
}

function parse(text: Uint8Array): GltfJson {
  let json: unknown;
  try {
    json = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(text));
  } catch (error) {
    fail("the file", `JSON in its first chunk (${String(error).slice(0, 120)})`);
  }
  return record(json, "the file");
}

/** Throws a `FormatError` when the document names another file: for pages that must not lead elsewhere. */
export function checkSelfContained(json: GltfJson): void {
  for (const name of ["images", "buffers"]) {
    list(json[name] ?? [], name, LIMITS.entries).forEach((entry, i) => {
      const { uri } = record(entry, `${name}[${i}]`);
      if (typeof uri === "string" && !uri.startsWith("data:"))
        fail(`${name}[${i}].uri`, `a self-contained file; it refers to ${uri.slice(0, 80)}`);
    });
  }
}
