/** Test vectors of `format/vectors`, as the web runtime sees them. */

import { readdirSync, readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import {
  type BufferType,
  type Graph,
  readGraph,
  type StoredBuffer,
  toHalf,
} from "../runtime/src/graph/index.ts";

const FOLDER = fileURLToPath(new URL("../../format/vectors/", import.meta.url));
const STORAGE = { float32: Float32Array, float16: Uint16Array, int8: Int8Array, uint8: Uint8Array } as const;

interface Tensor {
  readonly shape: readonly [number, number];
  readonly data: readonly number[];
}

interface VectorFile {
  readonly name: string;
  readonly graph: {
    readonly inputs: Record<string, number>;
    readonly buffers: Record<
      string,
      { shape: number[]; type: BufferType; scale?: number | number[]; offset?: number }
    >;
    readonly nodes: Record<string, unknown>[];
    readonly outputs: Record<string, string>;
  };
  readonly arrays: Record<string, number[]>;
  readonly inputs: Record<string, Tensor>;
  readonly outputs: Record<string, Tensor>;
}

/** A graph with inputs and expected outputs at N points; inputs of one row are shared by all points. */
export interface Vector {
  readonly name: string;
  readonly json: VectorFile["graph"];
  readonly buffers: Map<string, StoredBuffer>;
  readonly graph: Graph;
  readonly points: number;
  readonly inputs: Record<string, Tensor>;
  readonly outputs: Record<string, Tensor>;
}

/** All vectors, in the order of their names. */
export function loadVectors(): Vector[] {
  const names = readdirSync(FOLDER).filter((file) => file.endsWith(".json"));
  return names.sort().map((file) => toVector(JSON.parse(readFileSync(FOLDER + file, "utf8"))));
}

function toVector({ name, graph: json, arrays, inputs, outputs }: VectorFile): Vector {
  const buffers = new Map<string, StoredBuffer>();
  for (const [key, declared] of Object.entries(json.buffers)) {
    const numbers = arrays[key]!;
    const data = STORAGE[declared.type].from(declared.type === "float16" ? numbers.map(toHalf) : numbers);
    buffers.set(key, { ...declared, data });
  }
  const points = Math.max(...Object.values(inputs).map((tensor) => tensor.shape[0]));
  return { name, json, buffers, graph: readGraph(json, buffers), points, inputs, outputs };
}

/** The row of an input at a point. */
export function row({ shape: [rows, width], data }: Tensor, point: number): number[] {
  const at = rows === 1 ? 0 : point;
  return data.slice(at * width, (at + 1) * width);
}

/** Largest error of an output, relative to max(1, |expected|); infinite when something is not a number. */
export function worstError(found: ArrayLike<number>, expected: readonly number[]): number {
  if (found.length !== expected.length) return Infinity;
  const errors = expected.map((y, i) => Math.abs(found[i]! - y) / Math.max(1, Math.abs(y)));
  return errors.every((e) => e >= 0) ? Math.max(...errors) : Infinity;
}
