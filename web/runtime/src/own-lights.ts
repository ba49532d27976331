/** Takes the lights of a file away whose light is learned, and puts them back. */

import { Light, Object3D } from "three";

/** A light that was taken away, and the node in its place. */
export interface Taken {
  readonly light: Light;
  readonly stand: Object3D;
}

/** The light of the file's own lights is in the static field, if anywhere; what hangs on them stays. */
export class OwnLights {
  taken: readonly Taken[] = [];

  /** Put an empty node in the place of every light under `root`. */
  remove(root: Object3D): void {
    const lights: Light[] = [];
    root.traverse((object) => {
      if (object instanceof Light) lights.push(object);
    });
    this.taken = lights.map((light) => {
      const stand = new Object3D().copy(light as unknown as Object3D, false);
      // What animates the light by its name or place in the tree finds these.
      const intensity = { get: () => light.intensity, set: (value: number) => (light.intensity = value) };
      Object.defineProperties(stand, { intensity, color: { value: light.color } });
      replace(light, stand);
      return { light, stand };
    });
  }

  /** Put them back. */
  restore(): void {
    for (const { light, stand } of this.taken) replace(stand, light);
    this.taken = [];
  }
}

/** Put a node in the place of another one, with all that hangs on it except for a light's own target. */
function replace(old: Object3D, node: Object3D): void {
  const target = (old as { target?: Object3D }).target;
  const children = old.children.filter((child) => child !== target);
  if (children.length > 0) node.add(...children);
  old.parent?.add(node);
  old.removeFromParent();
}
