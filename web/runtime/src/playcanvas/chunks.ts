/** What PlayCanvas' shader of standard materials is given beside its own text. */

import { DISTANCE_PASS } from "./distance-cube.ts";

/** Defined while distances are drawn. */
const IN_PASS = `${DISTANCE_PASS.toUpperCase()}_PASS`;

/** Colour and reflectance before metals lose their diffuse part. */
const DECLARATION = `
vec3 lightwellBase;
vec3 lightwellSpecular;
`;

const METALNESS = `
vec3 getSpecularModulate(in vec3 specularity, in vec3 albedo, in float metalness, in float f0, in float specularityFactor) {
  lightwellBase = albedo;
  lightwellSpecular = f0 * specularity * specularityFactor;
  return mix(lightwellSpecular, albedo, metalness);
}
vec3 getAlbedoModulate(in vec3 albedo, in float metalness) {
  return albedo * (1.0 - metalness);
}
`;

/** Adds the light before fog and tone curve; in the pass of distances there is nothing else. */
const END = `
#ifdef ${IN_PASS}
  gl_FragColor.rgb = vec3(length(vPositionW - view_position));
#else
  gl_FragColor.rgb = combineColor(litArgs_albedo, litArgs_sheen_specularity, litArgs_clearcoat_specularity);
  gl_FragColor.rgb += litArgs_emission;
  #ifdef LIT_METALNESS
    gl_FragColor.rgb += lightwellShade(lightwellSurface(lightwellToFile, vPositionW, dVertexNormalW, litArgs_worldNormal, dViewDirW, lightwellBase, lightwellSpecular, 1.0 - litArgs_gloss, litArgs_metalness, mat3(matrix_view)));
  #endif
  gl_FragColor.rgb = addFog(gl_FragColor.rgb);
  gl_FragColor.rgb = toneMap(gl_FragColor.rgb);
  gl_FragColor.rgb = gammaCorrectOutput(gl_FragColor.rgb);
#endif
`;

/**
 * Chunks of a material that shows a file's light, by their names.
 *
 * Args: GLSL of the light; the engine's own text of the chunk `combinePS`, which stays.
 */
export function chunksOf(code: string, combine: string): Readonly<Record<string, string>> {
  return {
    litUserDeclarationPS: DECLARATION,
    metalnessModulatePS: METALNESS,
    combinePS: `${combine}\n#ifndef ${IN_PASS}\nuniform mat4 lightwellToFile;\nuniform mat4 matrix_view;\n${code}\n#endif\n`,
    endPS: END,
  };
}
