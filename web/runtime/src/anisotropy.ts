/** How textures are filtered on surfaces that are seen at a grazing angle. */

import { type Material, type Mesh, type Object3D, Texture } from "three";

/** Texels along the longer axis of the footprint of a pixel; three.js lowers it to what the device offers. */
const ANISOTROPY = 8;

/**
 * Filter the textures of a scene anisotropically: three.js does not by default, and a tiled floor turns grey with
 * distance. Call it before the scene is first drawn. Textures that ask for more keep it.
 */
export function filterAnisotropically(root: Object3D, anisotropy = ANISOTROPY): void {
  root.traverse((object) => {
    const held = (object as Mesh).material as Material | Material[] | undefined;
    for (const material of [held ?? []].flat()) {
      for (const texture of Object.values(material)) {
        if (texture instanceof Texture) texture.anisotropy = Math.max(texture.anisotropy, anisotropy);
      }
    }
  });
}
