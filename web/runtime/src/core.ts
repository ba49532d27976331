/** The part of a scene that is looked at: its objects, without ground of kilometres and domes of sky. */

import { Box3, Vector3 } from "three";
import type { CoreRecord } from "./core-record.ts";

/** The box that is looked at in a scene with these bounds: all of it where the file names no part, or one that is not there. */
export function coreOf(core: CoreRecord | null, bounds: Box3): Box3 {
  if (core === null) return bounds;
  const box = new Box3(new Vector3(...core.low), new Vector3(...core.high)).intersect(bounds);
  return box.isEmpty() ? bounds : box;
}

/** Distances that a camera draws which stands as far as ten diagonals of the core from it: the core itself well, and all of the scene. */
export function clippingPlanes(core: Box3, bounds: Box3): [number, number] {
  const [size, all] = [core, bounds].map((box) => Math.max(box.getSize(new Vector3()).length(), 1e-6)) as [number, number];
  return [2e-3 * size, Math.max(40 * size, 10 * size + 2 * all)];
}
