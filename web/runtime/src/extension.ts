/** Reads the glTF extension `LIGHTWELL_neural_radiance` (see `format/FORMAT.md`). */

import { fail, integer, list, number, record, text } from "./checks.ts";
import type { GltfJson } from "./container.ts";
import { LIMITS } from "./limits.ts";
import { type CoreRecord, readCore } from "./core-record.ts";
import { type EnvironmentRecord, readEnvironment } from "./environment.ts";
import { BUDGET, type Budget, overBudget } from "./graph/budget.ts";
import { evaluate } from "./graph/evaluate.ts";
import { readGraphOf } from "./graph/graph.ts";
import type { Graph } from "./graph/node.ts";
import type { BufferType, StoredBuffer } from "./graph/stored.ts";
import { opsFor } from "./graph/ops/on-demand.ts";
import { EXTENSION } from "./extension-name.ts";
import { type LampRecord, readLamps } from "./switches.ts";
import { type MoverRecord, readMovers } from "./mover-record.ts";
import { TRIAL } from "./trial.ts";
import { readVariables, type Variable } from "./variables.ts";

/** Newest version of the format that this package reads; it reads the older ones too. */
export const FORMAT_VERSION = 2;

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
  /** Nodes that move, in the order of the graphs' input `pose`. */
  readonly movers: readonly MoverRecord[];
  /** Groups of the scene's own lamps, in the order of the graphs' input `lamps`. */
  readonly lamps: readonly LampRecord[];
  readonly fields: readonly FieldRecord[];
  /** The same light in the air, for what is added to the scene; empty when the file has none. */
  readonly probes: readonly FieldRecord[];
  /** Whether the fields hold what clear glass reflects. */
  readonly glass?: boolean;
  /** Linear factor before tone mapping that suits the scene; null when the file says none. */
  readonly exposure: number | null;
  /** The part of the scene that is looked at; null where it is all of it. */
  readonly core: CoreRecord | null;
  /** What surrounds the scene; null where nothing does, or nothing that stands still. */
  readonly environment: EnvironmentRecord | null;
}

/** Largest factor of an exposure, and one over the smallest. */
const MAX_EXPOSURE = 1e6;

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
  rest_position: 3,
  rest_normal: 3,
  uv: 2,
  uv1: 2,
};

/** Those that a place in the air offers to probes. */
const PROBE_INPUTS = /^(position|normal|light|lamps|pose)$/;

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

/**
 * Read the extension of a glTF document; null when the document does not carry it. Throws a `FormatError` when it is not as
 * `format/FORMAT.md` says, or asks for more work than the budget.
 */
export async function readExtension(
  json: GltfJson,
  sources: Sources,
  budget: Budget = BUDGET,
): Promise<NeuralRadiance | null> {
  const extensions = json.extensions === undefined ? {} : record(json.extensions, "extensions");
  if (extensions[EXTENSION] === undefined) return null;
  const extension = record(extensions[EXTENSION], EXTENSION);
  const { version } = extension;
  if (version !== 1 && version !== FORMAT_VERSION) fail(`${EXTENSION}.version`, `1 or ${FORMAT_VERSION}`);
  const variables = readVariables(extension.variables, `${EXTENSION}.variables`);
  if (version === 1 && extension.lamps !== undefined) fail(`${EXTENSION}.lamps`, "nothing of that name in version 1");
  const skies = variables.findIndex((variable) => variable.kind === "sun" && variable.sky !== null);
  if (version === 1 && skies >= 0) fail(`${EXTENSION}.variables[${skies}].sky`, "nothing of that name in version 1");
  const turning = variables.findIndex(({ kind }) => kind === "environment");
  if (version === 1 && turning >= 0) fail(`${EXTENSION}.variables[${turning}].kind`, '"point" or "sun" in version 1');
  const lamps = readLamps(extension.lamps, `${EXTENSION}.lamps`);
  const movers = readMovers(extension.variables, `${EXTENSION}.variables`, { nodes: list(json.nodes ?? [], "nodes", LIMITS.entries), animations: json.animations });
  if (version === 1 && movers.length > 0) fail(`${EXTENSION}.variables`, "no node or clip in version 1");
  if (version === 1 && extension.probes !== undefined) fail(`${EXTENSION}.probes`, "nothing of that name in version 1");
  const from = { json, sources, budget, lamps: lamps.length, movers: movers.length };
  const fields = await readFields(extension.fields, `${EXTENSION}.fields`, variables.length, from);
  const probes = await readFields(extension.probes, `${EXTENSION}.probes`, variables.length, from);
  for (const { name, graph } of probes) {
    for (const input of graph.inputs.keys()) if (!PROBE_INPUTS.test(input)) fail(`${EXTENSION}.probes '${name}'`, `inputs of the air, found ${input}`);
  }
  const exposure = extension.exposure === undefined ? null : number(extension.exposure, `${EXTENSION}.exposure`, 1 / MAX_EXPOSURE, MAX_EXPOSURE);
  const core = readCore(extension.core, `${EXTENSION}.core`);
  const environment = readEnvironment(extension.environment, `${EXTENSION}.environment`, json.textures, lamps.length);
  return { variables, movers, lamps, fields, probes, glass: extension.glass === true, exposure, core, environment };
}

/** What the parts of the extension are read from. */
interface Reading {
  readonly json: GltfJson;
  readonly sources: Sources;
  readonly budget: Budget;
  /** Number of lamps with a switch. */
  readonly lamps: number;
  /** Number of nodes and clips that move. */
  readonly movers: number;
}

/** Fields, or probes: a surface evaluates all of the one or all of the other. */
async function readFields(value: unknown, where: string, lights: number, from: Reading): Promise<FieldRecord[]> {
  const fields: FieldRecord[] = [];
  for (const [i, entry] of list(value ?? [], where, MAX_FIELDS).entries()) {
    fields.push(await readField(entry, `${where}[${i}]`, lights, from));
    const work = fields.reduce((sum, { graph }) => sum + graph.work, 0);
    if (work > from.budget.work) fail(`${where}[${i}]`, overBudget(from.budget.work, "operations per pixel in all fields", "work"));
  }
  return fields;
}

async function readField(value: unknown, where: string, variableCount: number, from: Reading): Promise<FieldRecord> {
  const entry = record(value, where);
  const role = entry.role;
  if (role !== "indirect" && role !== "static") fail(`${where}.role`, '"indirect" or "static"');
  const document = record(entry.graph, `${where}.graph`);
  const buffers = await readBuffers(document.buffers ?? {}, `${where}.graph.buffers`, from);
  const graph = await readFieldGraph(document, buffers, `${where}.graph`, from);
  warnOfOverflow(graph, where);
  return {
    name: text(entry.name ?? role, `${where}.name`),
    role,
    variable:
      role === "static" ? -1 : integer(entry.variable ?? 0, `${where}.variable`, 0, variableCount - 1),
    graph,
    buffers,
  };
}

/** Finite weights may still overflow: try the field at one point, and say so when its light is no number there. */
function warnOfOverflow(graph: Graph, where: string): void {
  if (graph.nodes.some(({ use }) => Object.values(use.buffer).some(({ picture }) => picture))) return;
  const found = evaluate(graph, { ...TRIAL, lamps: Array(graph.inputs.get("lamps") ?? 0).fill(1), pose: Array(graph.inputs.get("pose") ?? 0).fill(0.5) }).radiance!;
  if (found.every(Number.isFinite)) return;
  console.warn(`lightwell: ${where}: expected finite radiance at the origin, found ${found.join(", ")}; bake the field again`);
}

/** The graph of a field: its inputs are those that a surface has, its output is `radiance`. */
async function readFieldGraph(
  document: Record<string, unknown>,
  buffers: ReadonlyMap<string, StoredBuffer>,
  where: string,
  { budget, lamps, movers }: Reading,
): Promise<Graph> {
  const nodes: { op?: unknown }[] = Array.isArray(document.nodes) ? document.nodes : [];
  const graph = readGraphOf(await opsFor(nodes.map((node) => String(node?.op))), document, buffers, budget);
  for (const [name, width] of graph.inputs) {
    if (name === "pose" && movers > 0 && width === movers) continue;
    if (name === "lamps" ? lamps === 0 || width !== 3 * lamps : INPUT_WIDTHS[name] !== width)
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

async function readBuffers(value: unknown, where: string, from: Reading): Promise<Map<string, StoredBuffer>> {
  const entries = Object.entries(record(value, where));
  if (entries.length > MAX_BUFFERS) fail(where, `at most ${MAX_BUFFERS} buffers`);
  const forms = entries.map(([id, entry]) => readForm(entry, `${where}.${id.slice(0, 64)}`));
  const elements = forms.reduce((sum, { count }) => sum + count, 0);
  if (elements > MAX_ELEMENTS) fail(where, `at most ${MAX_ELEMENTS} elements in all, found ${elements}`);
  const buffers = new Map<string, StoredBuffer>();
  for (const [i, [id]] of entries.entries()) buffers.set(id, await readBuffer(forms[i]!, from));
  return buffers;
}

/** A buffer as it is declared, before its numbers are looked at. */
interface BufferForm {
  readonly entry: Record<string, unknown>;
  readonly where: string;
  readonly count: number;
  readonly form: Omit<StoredBuffer, "data">;
}

function readForm(value: unknown, where: string): BufferForm {
  const entry = record(value, where);
  const { type } = entry;
  if (typeof type !== "string" || !Object.hasOwn(STORAGE, type)) fail(`${where}.type`, Object.keys(STORAGE).join(", "));
  const shape = list(entry.shape, `${where}.shape`, 4).map((n, i) =>
    integer(n, `${where}.shape[${i}]`, 1, MAX_ELEMENTS),
  );
  const count = shape.reduce((a, b) => a * b, 1);
  if (shape.length === 0 || count > MAX_ELEMENTS)
    fail(`${where}.shape`, `1 to 4 sizes, at most ${MAX_ELEMENTS} elements`);
  const form = { shape, type: type as BufferType, ...readQuantisation(entry, where, type as BufferType) };
  return { entry, where, count, form };
}

async function readBuffer({ entry, where, count, form }: BufferForm, { json, sources }: Reading): Promise<StoredBuffer> {
  if (entry.texture !== undefined) return { ...form, ...(await readPicture(entry, where, form, json, sources)) };
  return {
    ...form,
    data: await readAccessor(json, entry.accessor, `${where}.accessor`, form.type, count, sources),
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

/** `scale` and `offset` of a buffer; the graph checks how many there must be. */
function readQuantisation(
  entry: Record<string, unknown>,
  where: string,
  type: BufferType,
): Pick<StoredBuffer, "scale" | "offset"> {
  const { scale, offset = 0 } = entry;
  // The graph refuses either on a float type.
  if (type === "int8" || type === "uint8") {
    number(offset, `${where}.offset`);
    for (const x of [scale].flat()) number(x, `${where}.scale`);
  }
  return { scale, offset } as Pick<StoredBuffer, "scale" | "offset">;
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
  const accessors = list(json.accessors ?? [], "accessors", LIMITS.entries);
  const accessor = record(accessors[integer(index, where, 0, accessors.length - 1)], where);
  if (accessor.type !== "SCALAR") fail(`${where}.type`, "SCALAR");
  if (accessor.componentType !== componentType) fail(`${where}.componentType`, `${componentType}`);
  if (accessor.count !== count) fail(`${where}.count`, `${count}`);
  if (accessor.sparse !== undefined) fail(where, "a dense accessor");
  const views = list(json.bufferViews ?? [], "bufferViews", LIMITS.entries);
  const viewIndex = integer(accessor.bufferView, `${where}.bufferView`, 0, views.length - 1);
  const view = record(views[viewIndex], `bufferViews[${viewIndex}]`);
  // Compressors pad elements to four bytes, and say so in their own extension alone.
  const stride = view.byteStride ?? packedStride(view) ?? bytes;
  const step = integer(stride, `${where}.byteStride`, bytes, 4) / bytes;
  if (!Number.isInteger(step)) fail(`${where}.byteStride`, `a multiple of ${bytes}`);
  const start = integer(accessor.byteOffset ?? 0, `${where}.byteOffset`, 0, Number.MAX_SAFE_INTEGER);
  if (start % bytes) fail(`${where}.byteOffset`, `a multiple of ${bytes}`);
  const data = await sources.bufferView(viewIndex);
  const end = start + count * step * bytes;
  if (end > data.byteLength) fail(where, `${end} bytes, found ${data.byteLength}`);
  const numbers = new Data(data, start, count * step);
  return step === 1 ? numbers : numbers.filter((_, i) => i % step === 0);
}

/** Bytes from element to element of a compressed view; undefined when it is not compressed. */
function packedStride(view: Record<string, unknown>): unknown {
  const extensions = view.extensions === undefined ? {} : record(view.extensions, "bufferViews.extensions");
  const packed = extensions.EXT_meshopt_compression;
  return packed === undefined ? undefined : record(packed, "bufferViews.extensions.EXT_meshopt_compression").byteStride;
}
