/** A shadow map for each renderer: that of three.js' own light nodes belongs to the light, and a second renderer would take it away. */

import type { DirectionalLight, PointLight } from "three";
import { Node, type NodeBuilder } from "three/webgpu";
import type { AnyNode } from "./field-nodes.ts";
import { liftedShadow } from "./lifted-shadow.ts";

/** What `light.shadow.shadowNode` may be: the shadow of a light, asked for whenever a material is compiled. */
export class RendererShadows extends (Node as AnyNode) {
  readonly light: PointLight | DirectionalLight;
  private readonly shadows = new Map<object, AnyNode>();

  constructor(light: PointLight | DirectionalLight) {
    super();
    this.light = light;
  }

  setup({ renderer }: NodeBuilder): AnyNode {
    const { light, shadows } = this;
    if (!shadows.has(renderer)) shadows.set(renderer, liftedShadow(light));
    return shadows.get(renderer);
  }

  /** Called when the light no longer casts a shadow or is disposed of. */
  dispose(): void {
    for (const shadow of this.shadows.values()) shadow.dispose();
    this.shadows.clear();
    super.dispose();
  }
}
