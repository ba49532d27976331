/** Path-traced pictures of the saved views. */

import { ClampToEdgeWrapping, DataTexture, DataUtils, HalfFloatType, LinearFilter, RGBAFormat } from "three";
import { decodeBase64 } from "./base64.ts";
import { gunzip } from "./gunzip.ts";
import type { ViewData } from "./page-data.ts";

/** Bits of 1.0 as a half float, and the largest finite half float. */
const HALF_ONE = 0x3c00;
const MAX_HALF = 65504;
/** Steps in a factor of two of radiance. */
const STEPS = 128;

/** Decode the reference of a view to a half-float texture, first row at v = 0. */
export async function decodeReference(view: ViewData): Promise<DataTexture> {
  const { width, height } = view;
  const bytes = await gunzip(decodeBase64(view.reference), 6 * width * height, "reference");
  const [green, red, blue] = [0, 1, 2].map((plane) => decodePlane(bytes, plane, width, height));
  const halfOf = halves(view.dark);
  const rgba = new Uint16Array(4 * width * height);
  for (let i = 0; i < width * height; i++) {
    rgba[4 * i] = halfOf(red![i]! + green![i]!);
    rgba[4 * i + 1] = halfOf(green![i]!);
    rgba[4 * i + 2] = halfOf(blue![i]! + green![i]!);
    rgba[4 * i + 3] = HALF_ONE;
  }
  const texture = new DataTexture(rgba, width, height, RGBAFormat, HalfFloatType);
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.wrapS = texture.wrapT = ClampToEdgeWrapping;
  texture.needsUpdate = true;
  return texture;
}

/** Codes of one of the three planes: high bytes of all planes come first, then low bytes; each code is its prediction plus a remainder. */
function decodePlane(bytes: Uint8Array, plane: number, width: number, height: number): Int32Array {
  const texels = width * height;
  const codes = new Int32Array(texels);
  for (let i = 0, at = plane * texels; i < texels; i++, at++) {
    const [x, y] = [i % width, Math.floor(i / width)];
    const left = x ? codes[i - 1]! : 0;
    const above = y ? codes[i - width]! : 0;
    const corner = x && y ? codes[i - width - 1]! : 0;
    // The predictor of JPEG-LS (ITU-T T.87, A.4.1).
    const predicted = Math.min(Math.max(left + above - corner, Math.min(left, above)), Math.max(left, above));
    const folded = (bytes[at]! << 8) | bytes[3 * texels + at]!;
    codes[i] = predicted + ((folded >> 1) ^ -(folded & 1));
  }
  return codes;
}

/** The bits of the half float that a code stands for; each is computed once. */
function halves(dark: number): (code: number) => number {
  const known = new Map<number, number>();
  return (code) => {
    let half = known.get(code);
    if (half === undefined) {
      // A damaged page has any code.
      const radiance = dark * (2 ** (Math.max(code, 0) / STEPS) - 1);
      half = DataUtils.toHalfFloat(Math.min(radiance, MAX_HALF));
      known.set(code, half);
    }
    return half;
  };
}
