/** Puts learned light on a material for `WebGPURenderer` in place, and takes it off again. */

import type { Material, MeshStandardMaterial } from "three";
import type { Patch } from "../surface-materials.ts";
import type { AnyNode } from "./field-nodes.ts";

/** Properties that three.js' renderer takes from a material of any kind when it turns it into one of nodes. */
export interface SurfaceProperties {
  readonly emissiveNode?: AnyNode;
  /** The light of an environment map in place of the scene's; null leaves that. */
  readonly envNode?: AnyNode;
  /** The lights that shine on it in place of the scene's; null leaves those. */
  readonly lightsNode?: AnyNode;
  /** Makes the surface model of lights. */
  readonly setupLightingModel?: unknown;
}

/** Asked for whenever a material is compiled anew: nodes depend on the lamps. */
export interface NodeFinish {
  /** Names the program: those of different fields, or for different numbers of lamps, differ, and those of what moves. */
  key(material: Material): string;
  properties(material: Material): SurfaceProperties;
}

/**
 * While it is there, the material stays what it was, and edits of it show as they ever do. Nodes that the material's owner had
 * under the same names come back when it is taken off.
 */
export class NodePatch implements Patch {
  private readonly material: MeshStandardMaterial;
  private readonly finish: NodeFinish;
  private readonly owned = new Map<string, unknown>();

  constructor(material: MeshStandardMaterial, finish: NodeFinish) {
    this.material = material;
    this.finish = finish;
    const ownKey = material.customProgramCacheKey;
    this.set({ customProgramCacheKey: () => `${ownKey.call(material)}|lightwell:${finish.key(material)}` });
    this.renew();
  }

  renew(): void {
    this.set(this.finish.properties(this.material));
    this.material.needsUpdate = true;
  }

  restore(): void {
    const material = this.material as AnyNode;
    for (const [name, value] of this.owned) {
      if (value === undefined) delete material[name];
      else material[name] = value;
    }
    this.owned.clear();
    this.material.needsUpdate = true;
  }

  private set(properties: object): void {
    const material = this.material as AnyNode;
    for (const [name, value] of Object.entries(properties)) {
      if (!this.owned.has(name)) this.owned.set(name, Object.hasOwn(material, name) ? material[name] : undefined);
      material[name] = value;
    }
  }
}
