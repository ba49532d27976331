/** Reads the glTF extension `LIGHTWELL_neural_radiance` (see `format/FORMAT.md`). */

import { fail, integer, list, number, record, text } from "./checks.ts";
import type { GltfJson } from "./container.ts";
import { type BufferType, type Graph, readGraph, type StoredBuffer } from "./graph/index.ts";
import { readVariables, type Variable } from "./variables.ts";

/** Name of the extension. */
export const EXTENSION = "LIGHTWELL_neural_radiance";

/** Version of the format that this package reads. */
export const FORMAT_VERSION = 1;

/** Largest number of fields, and of buffer elements in all of them: limits against hostile files. */
const MAX_FIELDS = 8;
const MAX_BUFFERS = 1024;
const MAX_ELEMENTS = 1 << 26;

/** One learned field. */
export interface FieldRecord {
  readonly name: string;
  /** `indirect` follows a declared light; `static` is the light of the scene's own emitters. */
  readonly role: "indirect" | "static";
  /** Index of the declared light whose intensity and colour scale the field; -1 for a static field. */
  readonly variable: number;
  readonly graph: Graph;
  readonly buffers: ReadonlyMap<string, StoredBuffer>;
}

/** Everything the extension declares. */
export interface NeuralRadiance {
  readonly variables: readonly Variable[];
  readonly fields: readonly FieldRecord[];
}

/** Inputs that a surface offers to a field. */
const INPUT_WIDTHS: Readonly<Record<string, number>> = {
  position: 3,
  normal: 3,
  view: 3,
  light: 3,
  reflectance: 3,
  roughness: 1,
  metallic: 1,
  shading_normal: 3,
  uv: 2,
  uv1: 2,
};

/** Outputs of a field that mean something here; a graph may have others. */
const OUTPUT_WIDTHS: ReadonlyMap<string, number> = new Map(
  Object.entries({ radiance: 3, segment: 1, overlap: 1, second: 1 }),
);

/** How a buffer type travels in a glTF accessor: component type, bytes per element, constructor. */
const STORAGE = {
  float32: [5126, 4, Float32Array],
  float16: [5123, 2, Uint16Array],
  int8: [5120, 1, Int8Array],
  uint8: [5121, 1, Uint8Array],
} as const;

/** Deepest level of a picture's mipmaps that may be asked for. */
const MAX_MIPS = 12;

/** A decoded picture. */
export interface PictureSource {
  readonly source: unknown;
  readonly width: number;
  readonly height: number;
  /** Size of the encoded picture; 0 when unknown. */
  readonly bytes?: number;
}

/** Where the numbers of a document come from. */
export interface Sources {
  /** Gives the bytes of a buffer view. */
  bufferView(index: number): Promise<ArrayBuffer>;
  /** Gives the picture of a texture, and its size; what it is, only shaders know. */
  texture(index: number): Promise<PictureSource>;
}

/** Read the extension of a glTF document; null when the document does not carry it. */
export async function readExtension(
  json: GltfJson,
  sources: Sources,
): Promise<NeuralRadiance | null> {
  const extensions = json.extensions === undefined ? {} : record(json.extensions, "extensions");
  if (extensions[EXTENSION] === undefined) return null;
  const extension = record(extensions[EXTENSION], EXTENSION);
  if (extension.version !== FORMAT_VERSION) fail(`${EXTENSION}.version`, `${FORMAT_VERSION}`);
  const variables = readVariables(extension.variables, `${EXTENSION}.variables`);
  const fields: FieldRecord[] = [];
  const entries = list(extension.fields ?? [], `${EXTENSION}.fields`, MAX_FIELDS);
  for (const [i, entry] of entries.entries()) {
    fields.push(await readField(entry, `${EXTENSION}.fields[${i}]`, variables.length, json, sources));
  }
  return { variables, fields };
}

async function readField(
  value: unknown,
  where: string,
  variableCount: number,
  json: GltfJson,
  sources: Sources,
): Promise<FieldRecord> {
  const entry = record(value, where);
  const role = entry.role;
  if (role !== "indirect" && role !== "static") fail(`${where}.role`, '"indirect" or "static"');
  const document = record(entry.graph, `${where}.graph`);
  const buffers = await readBuffers(document.buffers ?? {}, `${where}.graph.buffers`, json, sources);
  return {
    name: text(entry.name ?? role, `${where}.name`),
    role,
    variable:
      role === "static" ? -1 : integer(entry.variable ?? 0, `${where}.variable`, 0, variableCount - 1),
    graph: readFieldGraph(document, buffers, `${where}.graph`),
    buffers,
  };
}

/** The graph of a field: its inputs are those that a surface has, its output is `radiance`. */
function readFieldGraph(document: unknown, buffers: ReadonlyMap<string, StoredBuffer>, where: string): Graph {
  const graph = readGraph(document, buffers);
  for (const [name, width] of graph.inputs) {
    if (INPUT_WIDTHS[name] !== width)
      fail(`${where}.inputs.${name}`, "an input of a surface");
  }
  if (!graph.outputs.has("radiance")) fail(`${where}.outputs.radiance`, "a value of width 3");
  for (const [name, width] of OUTPUT_WIDTHS) {
    const output = graph.outputs.get(name);
    if (output !== undefined && graph.widths.get(output) !== width)
      fail(`${where}.outputs.${name}`, `a value of width ${width}`);
  }
  return graph;
}

async function readBuffers(
  value: unknown,
  where: string,
  json: GltfJson,
  sources: Sources,
): Promise<Map<string, StoredBuffer>> {
  const entries = Object.entries(record(value, where));
  if (entries.length > MAX_BUFFERS) fail(where, `at most ${MAX_BUFFERS} buffers`);
  const buffers = new Map<string, StoredBuffer>();
  let elements = 0;
  for (const [id, entry] of entries) {
    const buffer = await readBuffer(entry, `${where}.${id}`, json, sources);
    elements += buffer.data.length;
    if (elements > MAX_ELEMENTS) fail(where, `at most ${MAX_ELEMENTS} elements in all`);
    buffers.set(id, buffer);
  }
  return buffers;
}

async function readBuffer(
  value: unknown,
  where: string,
  json: GltfJson,
  sources: Sources,
): Promise<StoredBuffer> {
  const entry = record(value, where);
  const type = entry.type as BufferType;
  if (!Object.hasOwn(STORAGE, String(type))) fail(`${where}.type`, Object.keys(STORAGE).join(", "));
  const shape = list(entry.shape, `${where}.shape`, 4).map((n, i) =>
    integer(n, `${where}.shape[${i}]`, 1, MAX_ELEMENTS),
  );
  const count = shape.reduce((a, b) => a * b, 1);
  if (shape.length === 0 || count > MAX_ELEMENTS)
    fail(`${where}.shape`, `1 to 4 sizes, at most ${MAX_ELEMENTS} elements`);
  const form = { shape, type, ...readQuantisation(entry, where, type) };
  if (entry.texture !== undefined) return { ...form, ...(await readPicture(entry, where, form, json, sources)) };
  return {
    ...form,
    data: await readAccessor(json, entry.accessor, `${where}.accessor`, type, count, sources),
  };
}

/** The picture that a buffer's numbers are the red, green and blue of. */
async function readPicture(
  entry: Record<string, unknown>,
  where: string,
  { shape, type }: Pick<StoredBuffer, "shape" | "type">,
  json: GltfJson,
  sources: Sources,
): Promise<Pick<StoredBuffer, "data" | "picture">> {
  if (entry.accessor !== undefined) fail(where, "one of accessor and texture");
  if (type !== "uint8" || shape.length !== 3 || shape[2] !== 3 || Array.isArray(entry.scale)) {
    fail(where, "uint8 [H, W, 3] with one scale");
  }
  const count = list(json.textures ?? [], "textures", MAX_ELEMENTS).length;
  const mips = integer(entry.mips ?? 0, `${where}.mips`, 0, MAX_MIPS);
  const { source, width, height, bytes = 0 } = await sources.texture(integer(entry.texture, `${where}.texture`, 0, count - 1));
  if (height !== shape[0] || width !== shape[1]) {
    fail(`${where}.texture`, `${shape[1]} × ${shape[0]} texels, found ${width} × ${height}`);
  }
  return { data: new Uint8Array(0), picture: { source, mips, bytes } };
}

/** `scale` and `offset` of an integer buffer; the graph checks how many there must be. */
function readQuantisation(
  entry: Record<string, unknown>,
  where: string,
  type: BufferType,
): Pick<StoredBuffer, "scale" | "offset"> {
  if (type === "float32" || type === "float16") return {};
  const offset = number(entry.offset ?? 0, `${where}.offset`);
  if (!Array.isArray(entry.scale)) return { scale: number(entry.scale ?? 1, `${where}.scale`), offset };
  const scale = list(entry.scale, `${where}.scale`, MAX_ELEMENTS);
  return { scale: scale.map((x, i) => number(x, `${where}.scale[${i}]`)), offset };
}

/** The `count` elements of a SCALAR accessor, bounds-checked. */
async function readAccessor(
  json: GltfJson,
  index: unknown,
  where: string,
  type: BufferType,
  count: number,
  sources: Sources,
): Promise<StoredBuffer["data"]> {
  const [componentType, bytes, Data] = STORAGE[type];
  const accessors = (json.accessors ?? []) as unknown[];
  const accessor = record(accessors[integer(index, where, 0, accessors.length - 1)], where);
  if (accessor.type !== "SCALAR") fail(`${where}.type`, "SCALAR");
  if (accessor.componentType !== componentType) fail(`${where}.componentType`, `${componentType}`);
  if (accessor.count !== count) fail(`${where}.count`, `${count}`);
  if (accessor.sparse) fail(where, "a dense accessor");
  const views = (json.bufferViews ?? []) as unknown[];
  const viewIndex = integer(accessor.bufferView, `${where}.bufferView`, 0, views.length - 1);
  const view = record(views[viewIndex], `bufferViews[${viewIndex}]`);
  // Compressors pad elements to four bytes, and say so in their own extension alone.
  const stride = view.byteStride ?? (view.extensions as any)?.EXT_meshopt_compression?.byteStride ?? bytes;
  const step = integer(stride, `${where}.byteStride`, bytes, 4) / bytes;
  const start = integer(accessor.byteOffset ?? 0, `${where}.byteOffset`, 0, Number.MAX_SAFE_INTEGER);
  if (start % bytes) fail(`${where}.byteOffset`, `a multiple of ${bytes}`);
  const data = await sources.bufferView(viewIndex);
  const end = start + count * step * bytes;
  if (end > data.byteLength) fail(where, `${end} bytes, found ${data.byteLength}`);
  return new Data(data, start, count * step).filter((_, i) => i % step === 0);
}
