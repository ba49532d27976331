/** Dequantised values of stored buffers. */

import { fromHalf } from "./half.ts";
import type { StoredBuffer } from "./op.ts";

const CACHE = new WeakMap<StoredBuffer, Float32Array>();

/** The 32-bit floats that a buffer stands for: value = stored · scale + offset. */
export function valuesOf(buffer: StoredBuffer): Float32Array {
  if (buffer.picture && buffer.data.length === 0) {
    throw new TypeError("graph: a picture has no numbers here");
  }
  let values = CACHE.get(buffer);
  if (!values) {
    values = dequantise(buffer);
    CACHE.set(buffer, values);
  }
  return values;
}

function dequantise({ data, type, scale, offset = 0 }: StoredBuffer): Float32Array {
  if (type === "float32") return data as Float32Array;
  if (type === "float16") return Float32Array.from(data, fromHalf);
  const scales = typeof scale === "number" ? [scale] : (scale ?? [1]);
  const perScale = data.length / scales.length;
  const out = new Float32Array(data.length);
  for (let i = 0; i < data.length; i++) {
    const step = Math.fround(scales[Math.floor(i / perScale)]!);
    out[i] = Math.fround(data[i]! * step) + Math.fround(offset);
  }
  return out;
}
