/** Where a pixel's surface is. */

import { modelWorldMatrix, positionLocal } from "three/tsl";
import type { AnyNode } from "./field-nodes.ts";

let covered: AnyNode = null;

/**
 * World point at the centroid of the covered samples: at the rim of a triangle the pixel's centre may lie beyond it, behind the
 * next wall, in a shadow that is not there.
 */
export function coveredPosition(): AnyNode {
  covered ??= (modelWorldMatrix as AnyNode).mul(positionLocal).xyz.toVarying("lightwellPosition").setInterpolation("perspective", "centroid");
  return covered;
}
