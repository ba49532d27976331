/** `core` of the extension: the part of a scene that is looked at, without ground of kilometres and domes of sky. */

import { fail, record, type Vec3, vec3 } from "./checks.ts";

/** Corners of a box, metres. */
export interface CoreRecord {
  readonly low: Vec3;
  readonly high: Vec3;
}

/** Read `core` of the extension; null where the whole scene is looked at. */
export function readCore(value: unknown, where: string): CoreRecord | null {
  if (value === undefined) return null;
  const entry = record(value, where);
  const [low, high] = [vec3(entry.low, `${where}.low`), vec3(entry.high, `${where}.high`)];
  if (low.some((x, i) => x >= high[i]!)) fail(where, "low below high");
  return { low, high };
}

/** Its diagonal, metres. */
export function coreDiagonal({ low, high }: CoreRecord): number {
  return Math.hypot(...low.map((x, i) => high[i]! - x));
}
