/** Where what moves rests, by material. */

import { type Material, Matrix4 } from "three";

/** Where surfaces of a material were before they moved, in the space of the root; for materials of what moves. */
export const TO_REST = new WeakMap<Material, Matrix4>();
const STILL = new Matrix4();

/** From the place of a material's surfaces to where they rest, in the space of the root. */
export function toRestOf(material: Material): Matrix4 {
  return TO_REST.get(material) ?? STILL;
}
