// Written by lightwell for PlayCanvas 2.
import { ADDRESS_CLAMP_TO_EDGE, FILTER_LINEAR, PIXELFORMAT_RGBA16F, Texture } from "playcanvas";

const LIT = new Set([{{ lit }}]);

/** Give the lit meshes below an entity, made from scene.glb, the light map; folder ends with a slash. */
export async function applyLightMap(app, entity, folder) {
  const response = await fetch(`${folder}light_map.bin`);
  if (!response.ok) throw new Error(`lightwell: light_map.bin: ${response.status}`);
  const map = new Texture(app.graphicsDevice, {
    name: "lightwell",
    width: {{ width }},
    height: {{ height }},
    format: PIXELFORMAT_RGBA16F,
    mipmaps: false,
    minFilter: FILTER_LINEAR,
    magFilter: FILTER_LINEAR,
    addressU: ADDRESS_CLAMP_TO_EDGE,
    addressV: ADDRESS_CLAMP_TO_EDGE,
    levels: [new Uint16Array(await response.arrayBuffer())],
  });
  for (const render of entity.findComponents("render")) {
    if (!LIT.has(render.entity.name)) continue;
    for (const instance of render.meshInstances) {
      const material = instance.material.clone();
      material.lightMap = map;
      material.lightMapUv = 1;
      material.lightMapChannel = "rgb";
      material.update();
      instance.material = material;
    }
  }
  return map;
}
