// Written by lightwell for Babylon.js 9. Light maps of Babylon's own materials are added without the albedo: this plugin
// adds albedo * light instead.
import { MaterialPluginBase } from "@babylonjs/core/Materials/materialPluginBase.js";
import { RawTexture } from "@babylonjs/core/Materials/Textures/rawTexture.js";
import { Constants } from "@babylonjs/core/Engines/constants.js";

const LIT = new Set([{{ lit }}]);

class LightwellLightMap extends MaterialPluginBase {
  constructor(material, map) {
    super(material, "LightwellLightMap", 210, { LIGHTWELL_LIGHT_MAP: true }, true, true);
    this.map = map;
  }
  getClassName() {
    return "LightwellLightMap";
  }
  prepareDefines(defines) {
    defines._needUVs = true;
    defines.UV2 = true;
    defines.MAINUV2 = true;
  }
  getSamplers(samplers) {
    samplers.push("lightwellMap");
  }
  bindForSubMesh(buffer) {
    buffer.setTexture("lightwellMap", this.map);
  }
  getCustomCode(type) {
    if (type !== "fragment") return null;
    return {
      CUSTOM_FRAGMENT_DEFINITIONS: "uniform sampler2D lightwellMap;",
      // The diffuse albedo of glTF; surfaceAlbedo lacks what the surface reflects at normal incidence.
      CUSTOM_FRAGMENT_BEFORE_FINALCOLORCOMPOSITION: `
#ifdef METALLICWORKFLOW
vec3 lightwellAlbedo = baseColor * (1.0 - reflectivityOut.metallic);
#else
vec3 lightwellAlbedo = surfaceAlbedo;
#endif
finalDiffuse += lightwellAlbedo * texture2D(lightwellMap, vMainUV2).rgb;`,
    };
  }
}

/** Give the lit meshes of scene.glb the light map; folder ends with a slash. WebGL only. */
export async function applyLightMap(scene, folder) {
  const response = await fetch(`${folder}light_map.bin`);
  if (!response.ok) throw new Error(`lightwell: light_map.bin: ${response.status}`);
  const data = new Uint16Array(await response.arrayBuffer());
  const bilinear = Constants.TEXTURE_BILINEAR_SAMPLINGMODE;
  const map = new RawTexture(data, {{ width }}, {{ height }}, Constants.TEXTUREFORMAT_RGBA, scene, false, false, bilinear, Constants.TEXTURETYPE_HALF_FLOAT);
  map.wrapU = map.wrapV = Constants.TEXTURE_CLAMP_ADDRESSMODE;
  for (const mesh of scene.meshes) {
    if (mesh.material && (LIT.has(mesh.name) || LIT.has(mesh.parent?.name))) new LightwellLightMap(mesh.material, map);
  }
  return map;
}
