/** Puts learned light on a material for `WebGPURenderer` in place, together with its owner's own nodes, and takes it off again. */

import type { Material, MeshStandardMaterial } from "three";
import type { NodeBuilder } from "three/webgpu";
import type { Patch } from "../surface-materials.ts";
import type { AnyNode } from "./field-nodes.ts";

/** Properties of a material of nodes while it is set up. */
export interface SurfaceProperties {
  readonly emissiveNode: AnyNode;
  /** The light of an environment map in place of the scene's; null leaves that. */
  readonly envNode: AnyNode;
  /** The lights that shine on it in place of the scene's; null leaves those. */
  readonly lightsNode: AnyNode;
  /** Makes the surface model of lights. */
  readonly setupLightingModel: unknown;
  /** What is drawn into targets beside the picture. */
  readonly mrtNode?: AnyNode;
}

/** Asked for whenever a material is compiled anew: nodes depend on the lamps. */
export interface NodeFinish {
  /** Names the program: those of different fields, or for different numbers of lamps, differ, and those of what moves. */
  key(material: Material): string;
  /** `own`: the material as its owner has it. */
  properties(own: SurfaceProperties, material: Material): SurfaceProperties;
}

/**
 * While it is there, the material stays what it was: edits of it show as they ever do, and nodes that its owner gives it, before or since,
 * are part of what is shown.
 */
export class NodePatch implements Patch {
  readonly material: MeshStandardMaterial;
  /** What the owner has set, before or since; undefined for what the class has. */
  private ownKey: (() => string) | undefined;

  /** `original`: the patch of the material that this one is a copy of. */
  constructor(material: MeshStandardMaterial, finish: NodeFinish, original?: NodePatch) {
    this.material = material;
    const subject = original?.material ?? material;
    if (Object.hasOwn(material, "customProgramCacheKey")) this.ownKey = material.customProgramCacheKey;
    // What is read calls the owner's function of that moment: a newer one may call it in turn.
    const keyAfter = (own: (() => string) | undefined) => () =>
      `${(own ?? Object.getPrototypeOf(material).customProgramCacheKey).call(material)}|lightwell:${finish.key(subject)}`;
    let key = keyAfter(this.ownKey);
    const set = (given: () => string) => {
      if (given !== key) [this.ownKey, key] = [given, keyAfter(given)];
    };
    Object.defineProperties(material, {
      customProgramCacheKey: { configurable: true, get: () => key, set },
      // A material of nodes that three.js makes of another one takes what can be enumerated; so does a copy of a material of nodes.
      setup: {
        configurable: true,
        enumerable: !("isNodeMaterial" in material),
        value(this: AnyNode, builder: NodeBuilder) {
          const properties = finish.properties(this, subject);
          const own = Object.keys(properties).map((name) => [name, Object.getOwnPropertyDescriptor(this, name)] as const);
          Object.assign(this, properties);
          Object.getPrototypeOf(this).setup.call(this, builder);
          // three.js looks for nodes on the material that this one is made of, and updates nothing by itself where there is none.
          Object.assign((builder as AnyNode).observer, { hasNode: true });
          for (const [name, descriptor] of own) {
            delete this[name];
            if (descriptor) Object.defineProperty(this, name, descriptor);
          }
        },
      },
    });
    material.needsUpdate = true;
  }

  renew(): void {
    this.material.needsUpdate = true;
  }

  restore(): void {
    const material = this.material as AnyNode;
    delete material.setup;
    delete material.customProgramCacheKey;
    if (this.ownKey) material.customProgramCacheKey = this.ownKey;
    material.needsUpdate = true;
  }
}
