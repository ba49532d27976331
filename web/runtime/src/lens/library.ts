/** Reads a library of spreadlets (`format/LENS.md`) from bytes that nobody vouches for. */

import { FormatError, fail, integer, list, number, record, text } from "../checks.ts";

const MAGIC = 0x5053574c;
const VERSION = 1;
/** Bounds that a file is held to before memory is asked for. */
const [MOST_BYTES, MOST_POINTS, MOST_RECORDS, MOST_NODES] = [1 << 29, 1 << 24, 1 << 20, 1 << 20];
const MOST_AXIS = 65_536;
const HEADER = 12;
const FAMILIES = ["depth", "depth-speed", "shaped-speed", "cats-eye"] as const;
const COLUMNS = ["node", "tier", "kind", "recipe", "first", "count", "scale", "peak"] as const;
/** Recipes without error: their pixels never need the finer tier. */
const EXACT = ["primal", "lossless"];

/** What a library's kernels depend on. */
export type SpreadletFamily = (typeof FAMILIES)[number];

/** One spreadlet: a run of points and what one unit of them weighs. */
export interface SpreadletRecord {
  /** First point, in points. */
  readonly first: number;
  readonly count: number;
  /** Weight of q = 1. */
  readonly scale: number;
  /** Points are charges, whose q sum to zero; else they are pixels. */
  readonly charge: boolean;
  /** Largest error of one pixel for one unit of light; 0 where there is none. */
  readonly peak: number;
}

/** A checked library. */
export interface SpreadletLibrary {
  readonly family: SpreadletFamily;
  readonly aperture: string;
  /** Node values: radius in px, length of motion in px or field radius, angle in radians. */
  readonly axes: readonly [Float32Array, Float32Array, Float32Array];
  /** Points as the file has them: one 32-bit word each for 8-bit offsets, two for 16-bit ones. */
  readonly points: Uint32Array;
  readonly offsetBits: 8 | 16;
  /** Main spreadlet of every node. */
  readonly main: readonly SpreadletRecord[];
  /** Spreadlet for bright pixels, where a node has one. */
  readonly fine: readonly (SpreadletRecord | null)[];
  /** Farthest that a point lies from its pixel along x or y, or in any direction once turned, up to each radius, px. */
  readonly reach: readonly number[];
}

/** Whether a family's points are turned, each writing to four pixels. */
export const turns = (family: SpreadletFamily): boolean => family === "depth-speed" || family === "cats-eye";

/** Read and check a library; every count, index and sum that the lens relies on holds afterwards. */
export async function readLibrary(data: ArrayBuffer | Uint8Array): Promise<SpreadletLibrary> {
  const bytes = data instanceof Uint8Array ? data : new Uint8Array(data);
  const { header, body } = split(bytes);
  if (header.format !== "lightwell-spreadlets") fail("library: format", '"lightwell-spreadlets"');
  const family = FAMILIES.find((name) => name === header.family) ?? fail("library: family", FAMILIES.join(", "));
  const offsetBits = header.offset_bits === 8 || header.offset_bits === 16 ? header.offset_bits : fail("library: offset_bits", "8 or 16");
  const points = integer(header.points, "library: points", 0, MOST_POINTS);
  if (body.length !== (points * offsetBits) / 2) fail("library", `${(points * offsetBits) / 2} bytes of points, found ${body.length}`);
  if ((await digest(body)) !== text(header.sha256, "library: sha256")) fail("library", "points that match their check sum");
  const axes = readAxes(header.axes);
  const words = new Uint32Array(body.slice().buffer);
  const nodes = axes[0].length * axes[1].length * axes[2].length;
  const found = readRecords(header.records, nodes, points, new PointReader(words, offsetBits));
  const missing = found.main.findIndex((one) => !one);
  if (missing >= 0) fail(`library: node ${missing}`, "a spreadlet; bake the whole library with lightwell lens bake");
  const far = turns(family) ? Math.hypot : (x: number, y: number) => Math.max(Math.abs(x), Math.abs(y));
  const reach = reachOf(found, axes[0].length, new PointReader(words, offsetBits), far);
  return { family, aperture: text(header.aperture, "library: aperture"), axes, points: words, offsetBits, ...found, main: found.main as SpreadletRecord[], reach };
}

function split(bytes: Uint8Array): { header: Record<string, unknown>; body: Uint8Array } {
  if (bytes.length < HEADER || bytes.length > MOST_BYTES) fail("library", `${HEADER} to ${MOST_BYTES} bytes, found ${bytes.length}`);
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (view.getUint32(0, true) !== MAGIC) fail("library", "a file that begins with LWSP");
  if (view.getUint32(4, true) !== VERSION) fail("library: version", `${VERSION}, found ${view.getUint32(4, true)}`);
  const length = view.getUint32(8, true);
  if (length % 4 !== 0 || HEADER + length > bytes.length) fail("library", "a whole header, of a multiple of 4 bytes");
  let header: unknown;
  try {
    header = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(bytes.subarray(HEADER, HEADER + length)));
  } catch {
    fail("library", "a header in JSON");
  }
  return { header: record(header, "library"), body: bytes.subarray(HEADER + length) };
}

async function digest(body: Uint8Array): Promise<string> {
  const hash = await crypto.subtle.digest("SHA-256", body.slice());
  return Array.from(new Uint8Array(hash), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

function readAxes(value: unknown): [Float32Array, Float32Array, Float32Array] {
  const axes = list(value, "library: axes", 3).map((axis, i) => {
    const where = `library: axes[${i}]`;
    const values = list(record(axis, where).values, `${where}: values`, MOST_AXIS).map((v) => number(v, where));
    if (values.length === 0 || values.some((v, k) => k > 0 && v <= values[k - 1]!)) fail(where, "ascending values");
    return Float32Array.from(values);
  });
  if (axes.length !== 3) fail("library: axes", "three axes");
  if (axes.reduce((n, axis) => n * axis.length, 1) > MOST_NODES) fail("library: axes", `at most ${MOST_NODES} nodes`);
  return axes as [Float32Array, Float32Array, Float32Array];
}

/** Points by number: offsets and value. */
class PointReader {
  private readonly words: Uint32Array;
  private readonly bits: 8 | 16;

  constructor(words: Uint32Array, bits: 8 | 16) {
    [this.words, this.bits] = [words, bits];
  }

  at(index: number): [dx: number, dy: number, q: number] {
    if (this.bits === 8) {
      const p = this.words[index]!;
      return [(p << 24) >> 24, (p << 16) >> 24, p >> 16];
    }
    const [a, b] = [this.words[2 * index]!, this.words[2 * index + 1]!];
    return [(a << 16) >> 16, a >> 16, (b << 16) >> 16];
  }
}

function readRecords(value: unknown, nodes: number, points: number, reader: PointReader) {
  const table = record(value, "library: records");
  const columns = COLUMNS.map((name) => list(table[name], `library: records: ${name}`, MOST_RECORDS));
  const total = columns[0]!.length;
  if (columns.some((column) => column.length !== total)) fail("library: records", "columns of one length");
  const main = new Array<SpreadletRecord | null>(nodes).fill(null);
  const fine = new Array<SpreadletRecord | null>(nodes).fill(null);
  let work = 0;
  for (let i = 0; i < total; i++) {
    const where = `library: record ${i}`;
    const [node, tier, kind, recipe, first, count, scale, peak] = columns.map((column) => column[i]);
    const index = integer(node, `${where}: node`, 0, nodes - 1);
    const into = integer(tier, `${where}: tier`, 0, 1) === 1 ? fine : main;
    if (kind !== "charge" && kind !== "primal") fail(`${where}: kind`, "charge or primal");
    const start = integer(first, `${where}: first`, 0, points);
    const length = integer(count, `${where}: count`, 1, points - start);
    if (into[index]) fail(where, `one spreadlet for node ${index}`);
    // Records may share points, but not so often that reading them takes for ever.
    work += length;
    if (work > 4 * MOST_POINTS) fail("library: records", "fewer points");
    const weight = number(scale, `${where}: scale`, 0, 1e6);
    if (Math.fround(weight) <= 0) fail(`${where}: scale`, "a number above 0");
    if (kind === "charge") neutral(reader, start, length, where);
    const error = EXACT.includes(text(recipe, `${where}: recipe`)) ? 0 : number(peak, `${where}: peak`, 0);
    into[index] = { first: start, count: length, scale: weight, charge: kind === "charge", peak: error };
  }
  return { main, fine };
}

function neutral(reader: PointReader, first: number, count: number, where: string): void {
  let sum = 0;
  for (let i = first; i < first + count; i++) sum += reader.at(i)[2];
  if (sum !== 0) fail(where, `charges that sum to 0, found ${sum}`);
}

function reachOf(
  { main, fine }: Readonly<Record<"main" | "fine", readonly (SpreadletRecord | null)[]>>,
  radii: number,
  reader: PointReader,
  far: (x: number, y: number) => number,
): number[] {
  const reach = new Array<number>(radii).fill(0);
  for (const table of [main, fine]) {
    table.forEach((one, node) => {
      for (let i = 0; one && i < one.count; i++) {
        const [dx, dy] = reader.at(one.first + i);
        reach[node % radii] = Math.max(reach[node % radii]!, far(dx, dy));
      }
    });
  }
  for (let i = 1; i < radii; i++) reach[i] = Math.max(reach[i]!, reach[i - 1]!);
  return reach.map(Math.ceil);
}

export { FormatError as LibraryError };
