// Written by lightwell for three.js 0.187.
import { ClampToEdgeWrapping, Data3DTexture, DataTexture, HalfFloatType, LinearFilter, RGBAFormat } from "three";

const LIT = new Set([{{ lit }}]);

async function halves(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`lightwell: ${url}: ${response.status}`);
  return new Uint16Array(await response.arrayBuffer());
}

/** Give the lit meshes of scene.glb the light map; folder ends with a slash. */
export async function applyLightMap(root, folder) {
  const map = new DataTexture(await halves(`${folder}light_map.bin`), {{ width }}, {{ height }}, RGBAFormat, HalfFloatType);
  map.channel = 1;
  map.magFilter = map.minFilter = LinearFilter;
  map.wrapS = map.wrapT = ClampToEdgeWrapping;
  map.needsUpdate = true;
  root.traverse((object) => {
    if (!object.isMesh || !(LIT.has(object.name) || LIT.has(object.userData.name) || LIT.has(object.parent?.userData.name))) return;
    object.material.lightMap = map;
    // The texels are irradiance / pi; three.js wants irradiance.
    object.material.lightMapIntensity = Math.PI;
    object.material.needsUpdate = true;
  });
  return map;
}
{% if grid %}

/** A LightProbeGridWebGL (three/addons/lighting/LightProbeGridWebGL.js) with the baked probes: scene.add(it). */
export async function probeGrid(LightProbeGridWebGL, folder) {
  const [nx, ny, nz] = [{{ grid.shape }}];
  const grid = new LightProbeGridWebGL({{ grid.size }}, nx, ny, nz);
  grid.position.set({{ grid.center }});
  grid.updateBoundingBox();
  // Seven packed volumes one behind the other, each between two copies of its outer slices.
  const atlas = new Data3DTexture(await halves(`${folder}probes.bin`), nx, ny, 7 * (nz + 2));
  atlas.format = RGBAFormat;
  atlas.type = HalfFloatType;
  atlas.magFilter = atlas.minFilter = LinearFilter;
  atlas.wrapS = atlas.wrapT = atlas.wrapR = ClampToEdgeWrapping;
  atlas.needsUpdate = true;
  grid.texture = atlas;
  return grid;
}
{% endif %}
