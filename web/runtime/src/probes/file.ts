/** Reads probe volumes (`format/PROBES.md`): checks everything, and makes of it the words that shaders read. */

import { FormatError } from "../checks.ts";
import { BRICK_WORDS, expanded } from "./tables.ts";
import { RECORDS } from "./weights.ts";

/** A probe volume: where it is, and the words that shaders read. */
export interface ProbeFile {
  /** Place of the first node, metres. */
  readonly origin: readonly [number, number, number];
  /** Distance of neighbouring nodes, metres. */
  readonly spacing: number;
  /** Nodes along x, y, z. */
  readonly shape: readonly [number, number, number];
  /** Surfaces are looked up this far off along their normal, in spacings; what moves asks without. */
  readonly offset: number;
  /** The weight function. */
  readonly function: string;
  /** Irradiance of 1 in the words. */
  readonly unit: number;
  /** Probes, those of bricks included. */
  readonly probes: number;
  readonly bricks: number;
  /** Whether it also holds light as it was traced and distance moments: baselines to compare with. */
  readonly baselines: boolean;
  /** First texel (four words) of each section; light as eight words a probe. 0 for sections that are not there. */
  readonly at: Readonly<Record<Section, number>>;
  readonly words: Uint32Array<ArrayBuffer>;
}

const SECTIONS = ["nodes", "weights", "light", "cells", "bricks", "sheets", "traced", "moments"] as const;
type Section = (typeof SECTIONS)[number];
const MOMENTS = 260;

const MAGIC = "LWPROBES";
const MOST_PROBES = 1 << 22;

class ProbeFileError extends FormatError {
  constructor(expected: string) {
    super(`probes: damaged file, expected ${expected}; bake it again`);
  }
}

function check(good: boolean, expected: string): asserts good {
  if (!good) throw new ProbeFileError(expected);
}

const isNumber = (value: unknown, low: number, high: number): value is number =>
  typeof value === "number" && value >= low && value <= high;

const isInteger = (value: unknown, low: number, high: number): value is number =>
  Number.isInteger(value) && isNumber(value, low, high);

/** Reads the bytes of a file. */
export function readProbes(bytes: ArrayBuffer): ProbeFile {
  check(bytes.byteLength >= 16, `${MAGIC} and a header`);
  const start = MAGIC.length + 4;
  const text = new TextDecoder();
  check(text.decode(new Uint8Array(bytes, 0, MAGIC.length)) === MAGIC, `${MAGIC} at the beginning`);
  const size = new DataView(bytes).getUint32(MAGIC.length, true);
  check(size <= 1 << 16 && start + size <= bytes.byteLength, "a header that ends in the file");
  let header: Record<string, unknown>;
  try {
    header = JSON.parse(text.decode(new Uint8Array(bytes, start, size))) as Record<string, unknown>;
  } catch {
    throw new ProbeFileError("a header of JSON");
  }
  const rest = bytes.slice(start + size);
  check(rest.byteLength % 4 === 0, "whole words");
  return assembled(header, new Uint32Array(rest));
}

function assembled(header: Record<string, unknown>, words: Uint32Array): ProbeFile {
  check(typeof header === "object" && header !== null && (header.version === 3 || header.version === 4), "version 3 or 4");
  const kind = header.function;
  check(typeof kind === "string" && Object.hasOwn(RECORDS, kind), `weights of ${Object.keys(RECORDS).join(", ")}`);
  const { origin, shape, spacing, offset, unit, coding } = header;
  check(Array.isArray(origin) && origin.length === 3 && origin.every((v) => isNumber(v, -1e9, 1e9)), "an origin");
  check(Array.isArray(shape) && shape.length === 3 && shape.every((v) => isInteger(v, 2, 1 << 16)), "a shape");
  check(isNumber(spacing, 1e-6, 1e6) && isNumber(offset, 0, 1) && isNumber(unit, 1e-30, 1e30), "spacing, offset and unit");
  check(coding === "l2" || coding === "zh3", "coding l2 or zh3");
  const [nx, ny, nz] = shape as [number, number, number];
  check(nx * ny * nz <= MOST_PROBES, "fewer nodes");
  const bytes = new Uint8Array(words.buffer as ArrayBuffer);
  const packed = (name: string, size: number): Uint8Array<ArrayBuffer> => {
    const place = (header.sections as Record<string, unknown> | undefined)?.[name];
    check(Array.isArray(place) && place.length === 2 && place.every((v) => isInteger(v, 0, bytes.length)), `section ${name}`);
    const [first, rows] = place as [number, number];
    check(first % 4 === 0 && 4 * first + 16 * Math.ceil((rows * size) / 16) <= bytes.length, `section ${name} in the file`);
    return bytes.subarray(4 * first, 4 * first + rows * size);
  };
  const stored = (name: string, width: number): Uint32Array<ArrayBuffer> => {
    const found = packed(name, 4 * width);
    return new Uint32Array(found.buffer, found.byteOffset, found.length / 4);
  };
  const baselines = typeof header.sections === "object" && header.sections !== null && "moments" in header.sections;
  const light = (name: string) => (coding === "l2" ? stored(name, 8) : fromZh3(stored(name, 5)));
  const none = new Uint32Array(0);
  const weights = stored("weights", RECORDS[kind]!);
  const octants = stored("octants", 2);
  check(octants.length / 2 === weights.length / RECORDS[kind]!, "octants of each record");
  const compact = { kinds: packed("kinds", 1), octants, light: light("light"), cells: packed("cells", 1), fallbacks: packed("fallbacks", 8) };
  const planes = () => {
    const found = packed("sheets", 10);
    return new Uint16Array(found.buffer, found.byteOffset, found.length / 2);
  };
  // Version 3 has no sheets.
  const newer = header.version === 4;
  const rest = newer ? { bricks: stored("bricks", 66), sheets: planes() } : { bricks: uncut(stored("bricks", 65)), sheets: new Uint16Array(0) };
  const tables = expanded({ ...compact, ...rest }, [nx, ny, nz], check);
  const parts: Record<Section, Uint32Array> = {
    ...tables,
    weights,
    traced: baselines ? light("traced") : none,
    moments: baselines ? stored("moments", MOMENTS) : none,
  };
  checkNumbers(compact.light, weights, kind);
  if (baselines) checkBaselines(parts, nx * ny * nz);
  const at = {} as Record<Section, number>;
  let total = 0;
  for (const name of SECTIONS) {
    at[name] = parts[name].length || name !== "moments" ? total / 4 : 0;
    total += parts[name].length;
  }
  if (!baselines) at.traced = 0;
  const joined = new Uint32Array(total);
  for (const name of SECTIONS) if (parts[name].length) joined.set(parts[name], 4 * at[name]);
  return {
    origin: origin as [number, number, number],
    shape: [nx, ny, nz],
    spacing,
    offset,
    unit,
    function: kind,
    baselines,
    probes: parts.nodes.length / 4,
    bricks: parts.bricks.length / BRICK_WORDS,
    at,
    words: joined,
  };
}

/** Bricks of version 3, of which no fine cell has a sheet. */
function uncut(rows: Uint32Array): Uint32Array {
  const out = new Uint32Array((rows.length / 65) * 66);
  for (let b = 0; b < rows.length / 65; b++) out.set(rows.subarray(65 * b, 65 * b + 65), 66 * b);
  return out;
}

/** Half floats of words from `first` on, `count` of them, are finite. */
function checkHalves(words: Uint32Array, first: number, count: number, what: string): void {
  for (let k = 0; k < count; k++) check(((words[first + (k >> 1)]! >>> (16 * (k & 1) + 10)) & 31) < 31, what);
}

function checkBaselines({ traced, moments }: Record<Section, Uint32Array>, nodes: number): void {
  check(traced.length === 8 * nodes && moments.length === MOMENTS * nodes, "baselines of each node");
  for (let i = 0; i < nodes; i++) {
    checkHalves(traced, 8 * i, 4, "finite light");
    for (let k = 0; k < 3; k++) check(((moments[MOMENTS * i + k]! >>> 23) & 255) < 255, "finite places");
    checkHalves(moments, MOMENTS * i + 4, 2 * (MOMENTS - 4), "finite moments");
  }
}

function checkNumbers(light: Uint32Array, weights: Uint32Array, kind: string): void {
  for (let i = 0; i < light.length; i += 8) checkHalves(light, i, 4, "finite light");
  // The steps of a network are its record's last words.
  if (kind.endsWith("mlp")) {
    for (let i = 0; i < weights.length; i += 32) for (let k = 29; k < 32; k++) check(((weights[i + k]! >>> 23) & 255) < 255, "finite weights");
  }
}

/** The value of a half float. */
export function half(bits: number): number {
  const [exponent, fraction] = [(bits >> 10) & 31, bits & 1023];
  const size = exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : (2 ** -14 * fraction) / 1024;
  return bits & 0x8000 ? -size : size;
}

const LUMINANCE = [0.2126, 0.7152, 0.0722] as const;
const BAND_2 = [1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396] as const;

/** Light of eight words a probe from five: the zonal value of each colour becomes five harmonics about the shared axis. */
function fromZh3(rows: Uint32Array): Uint32Array {
  const count = rows.length / 5;
  const out = new Uint32Array(8 * count);
  const code = new Int8Array(new Uint32Array(rows).buffer);
  const made = new Int8Array(out.buffer);
  for (let p = 0; p < count; p++) {
    out[8 * p] = rows[5 * p]!;
    const step = half(rows[5 * p + 1]! >>> 16);
    const low = (color: number, k: number) => code[20 * p + 8 + 4 * color + k]! * step;
    // Band 1 is (-y, z, -x).
    const axis = [2, 0, 1].map((k, i) => (i === 2 ? 1 : -1) * LUMINANCE.reduce((sum, w, c) => sum + w * low(c, k), 0));
    const length = Math.hypot(...axis);
    const [x, y, z] = length > 1e-12 ? axis.map((v) => v / length) : [0, 1, 0];
    const y2 = [x! * y!, y! * z!, 3 * z! * z! - 1, x! * z!, x! * x! - y! * y!].map((v, k) => v * BAND_2[k]!);
    const values = [0, 1, 2].map((c) => [
      ...[0, 1, 2].map((k) => low(c, k)),
      ...y2.map((v) => Math.sqrt((4 * Math.PI) / 5) * v * low(c, 3)),
    ]);
    const largest = Math.max(...values.flat().map(Math.abs));
    // The step is rounded up, so that bytes suffice.
    const bits = toHalf(largest / 127);
    out[8 * p + 1] = ((bits << 16) | (rows[5 * p + 1]! & 0xffff)) >>> 0;
    const fine = half(bits);
    values.forEach((numbers, c) => numbers.forEach((v, k) => (made[32 * p + 8 + 8 * c + k] = fine ? Math.round(v / fine) : 0)));
  }
  return out;
}

/** The least half float that is no smaller than a value, which is not negative. */
export function toHalf(value: number): number {
  let [low, high] = [0, 0x7bff];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (half(middle) < value) low = middle + 1;
    else high = middle;
  }
  return low;
}
