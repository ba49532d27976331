/** How far a learned picture is from its reference. */

import { DataUtils } from "three";

/** Errors of one picture. */
export interface Comparison {
  /** Mean of |f − y| / (y + ε), per channel; a fraction. */
  readonly relativeError: number;
  /** On x / (1 + x), sRGB-encoded, where x is radiance in the unit of 4 × the reference's mean; decibels. */
  readonly psnr: number;
}

/** Radiance unit over the reference's mean, and ε in that unit, as in the report of a bake. */
const UNIT_SHARE = 4;
export const FLOOR_SHARE = 0.01 * UNIT_SHARE;

/** Compare two RGBA half-float pictures; the learned one has its first row at the bottom. */
export function compare(
  learned: Uint16Array,
  reference: Uint16Array,
  width: number,
  height: number,
): Comparison {
  const mean = meanRadiance(reference);
  const [floor, unit] = [FLOOR_SHARE * mean, UNIT_SHARE * mean];
  let relative = 0;
  let squared = 0;
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const i = 4 * (y * width + x);
      const j = 4 * ((height - 1 - y) * width + x);
      for (let c = 0; c < 3; c++) {
        const f = DataUtils.fromHalfFloat(learned[j + c]!);
        const truth = DataUtils.fromHalfFloat(reference[i + c]!);
        relative += Math.abs(f - truth) / (truth + floor);
        squared += (encode(f / unit) - encode(truth / unit)) ** 2;
      }
    }
  }
  const count = 3 * width * height;
  return { relativeError: relative / count, psnr: -10 * Math.log10(Math.max(squared / count, 1e-12)) };
}

/** Mean over all channels of an RGBA half-float picture. */
export function meanRadiance(rgba: Uint16Array): number {
  let sum = 0;
  for (let i = 0; i < rgba.length; i += 4) {
    for (let c = 0; c < 3; c++) sum += DataUtils.fromHalfFloat(rgba[i + c]!);
  }
  return Math.max((sum * 4) / (3 * Math.max(rgba.length, 1)), 1e-9);
}

function encode(radiance: number): number {
  const x = Math.max(radiance, 0) / (1 + Math.max(radiance, 0));
  return x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055;
}
