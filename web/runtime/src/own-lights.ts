/** Takes the lights of a file away whose light is learned. */

import { Light, Object3D } from "three";

/** The light of the file's own lights is in the static field, if anywhere; what hangs on them stays. */
export function removeLights(root: Object3D): void {
  const lights: Object3D[] = [];
  root.traverse((object) => {
    if (object instanceof Light) lights.push(object);
  });
  for (const light of lights) {
    const node = new Object3D().copy(light, false);
    const children = light.children.filter((child) => child !== (light as { target?: Object3D }).target);
    if (children.length > 0) light.parent?.add(node.add(...children));
    light.removeFromParent();
  }
}
