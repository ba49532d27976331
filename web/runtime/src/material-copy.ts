/** Copies of the file's materials for surfaces that differ from the others in one thing. */

import type { Material } from "three";
import type { Lightmap } from "./lightmap.ts";
import { TO_REST } from "./to-rest.ts";

/**
 * A copy of a material with all that belongs to it: hooks and nodes of its owner, which `clone` leaves out, its light map, and where its
 * surfaces rest. The copy is added to `lightmaps`.
 */
export function copyOf<M extends Material>(material: M, lightmaps: Map<Material, Lightmap>): M {
  const copy = material.clone() as M;
  for (const name of Object.keys(material) as (keyof M)[]) {
    // What cannot be written is ours, of another scene that has the material; who listens to a material does not listen to its copy.
    const isOwners = name !== "_listeners" && Object.getOwnPropertyDescriptor(material, name)!.writable;
    if (isOwners && !Object.hasOwn(copy, name)) copy[name] = material[name];
  }
  const [lightmap, toRest] = [lightmaps.get(material), TO_REST.get(material)];
  if (lightmap) lightmaps.set(copy, lightmap);
  if (toRest) TO_REST.set(copy, toRest);
  return copy;
}
