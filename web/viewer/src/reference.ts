/** Path-traced pictures of the saved views. */

import { ClampToEdgeWrapping, DataTexture, HalfFloatType, LinearFilter, RGBAFormat } from "three";
import { decodeBase64 } from "./base64.ts";
import type { ViewData } from "./page-data.ts";

/** Bits of 1.0 as a half float. */
const HALF_ONE = 0x3c00;

/** Decode the reference of a view to a half-float texture, first row at v = 0. */
export async function decodeReference(view: ViewData): Promise<DataTexture> {
  const texels = view.width * view.height;
  const halves = new Uint16Array(await gunzip(decodeBase64(view.reference), texels * 6));
  const rgba = new Uint16Array(texels * 4);
  for (let i = 0; i < texels; i++) {
    for (let c = 0; c < 3; c++) rgba[4 * i + c] = finite(halves[3 * i + c]!);
    rgba[4 * i + 3] = HALF_ONE;
  }
  const texture = new DataTexture(rgba, view.width, view.height, RGBAFormat, HalfFloatType);
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.wrapS = texture.wrapT = ClampToEdgeWrapping;
  texture.needsUpdate = true;
  return texture;
}

/** Infinite and undefined values would spread through filters. */
function finite(half: number): number {
  return (half & 0x7c00) === 0x7c00 ? 0 : half;
}

/** Unpack exactly `size` bytes; stops as soon as there are more. */
async function gunzip(bytes: Uint8Array<ArrayBuffer>, size: number): Promise<ArrayBuffer> {
  const reader = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")).getReader();
  const result = new Uint8Array(size);
  let filled = 0;
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    if (filled + part.value.length > size) {
      await reader.cancel();
      throw new Error(`reference: more than the expected ${size} bytes`);
    }
    result.set(part.value, filled);
    filled += part.value.length;
  }
  if (filled !== size) throw new Error(`reference: expected ${size} bytes, found ${filled}`);
  return result.buffer;
}
