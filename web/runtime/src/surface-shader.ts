/** Finishes the shaders of three.js' standard and physical materials, and gives them a tighter shadow test. */

import {
  Matrix4,
  ShaderChunk,
  type WebGLProgramParametersWithUniforms,
  type WebGLRenderer,
} from "three";
import { rendererName } from "./device.ts";
import { MIN_REACH } from "./falloff.ts";
import { principledLight } from "./principled.ts";
import { replacePart } from "./shader-part.ts";
import { SHADOW_LIFT, SUN_EDGE } from "./shadow-lift.ts";
import type { SurfaceFinish } from "./surface-finish.ts";

/** Smallest reflectance that a learned value is multiplied by (format/FORMAT.md). */
const MIN_REFLECTANCE = "1e-3";

/** Dielectric reflectance at normal incidence for an index of refraction of 1.5 (glTF 2.0, appendix B). */
const DIELECTRIC_F0 = "0.04";

/** three.js' least square of the distance to a lamp. */
const LEAST_REACH = "0.01";

/** Finish the shader of a standard or physical material. */
export function patchSurfaceShader(
  shader: WebGLProgramParametersWithUniforms,
  renderer: WebGLRenderer,
  finish: SurfaceFinish,
  toRest = new Matrix4(),
): void {
  Object.assign(shader.uniforms, finish.uniforms(), { lightwellToRest: { value: toRest } });
  passCentroid(shader, renderer);
  if (finish.readsUv) passTextureCoordinates(shader);
  const parts = [
    ["void main() {", `${principledLight(COATS)}\n${DIRECT_LIGHT}\n${SHADOW_OFFSET}\nuniform mat4 lightwellToRoot;\nuniform mat4 lightwellToRest;\n${finish.functions()}\nvoid main() {`],
    ["#include <lights_pars_begin>", replacePart(ShaderChunk.lights_pars_begin, LEAST_REACH, MIN_REACH)],
    ["#include <lights_fragment_begin>", offsetShadows(ShaderChunk.lights_fragment_begin, hasCentroids(renderer))],
    ["#include <opaque_fragment>", `{\n${SURFACE}\n${finish.statements}\n}\n#include <opaque_fragment>`],
    ...(finish.environment ? [] : [["#include <lights_fragment_maps>", `#undef USE_ENVMAP\n#include <lights_fragment_maps>`] as const]),
  ] as const;
  for (const [part, text] of parts) shader.fragmentShader = replacePart(shader.fragmentShader, part, text);
}

/**
 * Hands the vector to the eye to the fragment shader at the centroid of the covered samples: at the rim of a triangle
 * the pixel's centre may lie beyond it, behind the next wall, in a shadow that is not there.
 */
function passCentroid(shader: WebGLProgramParametersWithUniforms, renderer: WebGLRenderer): void {
  const declaration = `${hasCentroids(renderer) ? "centroid " : ""}varying vec3 vLightwellToEye;`;
  shader.vertexShader = `${declaration}\n${replacePart(
    shader.vertexShader,
    "#include <worldpos_vertex>",
    "vLightwellToEye = vViewPosition;\n#include <worldpos_vertex>",
  )}`;
  shader.fragmentShader = `${declaration}\n${shader.fragmentShader}`;
}

/** llvmpipe (Mesa 22.3) evaluates centroids at wrong places, which shows as lines along the edges of triangles. */
function hasCentroids(renderer: WebGLRenderer): boolean {
  return !/llvmpipe/i.test(rendererName(renderer.getContext()));
}

/** Hands both texture coordinate sets to the fragment shader under names that no map of the material changes. */
function passTextureCoordinates(shader: WebGLProgramParametersWithUniforms): void {
  shader.vertexShader = replacePart(
    shader.vertexShader,
    "void main() {",
    `#ifndef USE_UV1
       attribute vec2 uv1;
     #endif
     varying vec4 vLightwellUv;
     void main() {
       vLightwellUv = vec4( uv, uv1 );`,
  );
  shader.fragmentShader = `varying vec4 vLightwellUv;\n${shader.fragmentShader}`;
}

/**
 * What a finish may know of the surface; point and facet are those of the shadow test. The normal's side is that of the
 * triangle: it must not switch inside a triangle at the silhouette.
 */
const SURFACE = `
  vec3 lwView = isOrthographic ? vec3( viewMatrix[ 0 ].z, viewMatrix[ 1 ].z, viewMatrix[ 2 ].z ) : normalize( cameraPosition - lwPosition );
  vec3 lwNormal = normalize( ( vec4( nonPerturbedNormal, 0.0 ) * viewMatrix ).xyz );
  lwNormal *= ( dot( lwFacet, lwView ) < 0.0 ) == ( dot( lwFacet, lwNormal ) < 0.0 ) ? 1.0 : - 1.0;
  vec3 lwBent = normalize( ( vec4( normal, 0.0 ) * viewMatrix ).xyz );
  lwBent -= min( 2.0 * dot( lwBent, lwNormal ), 0.0 ) * lwNormal;
  vec3 lwReflectance = max( diffuseColor.rgb + ${DIELECTRIC_F0} * ( 1.0 - metalnessFactor ), ${MIN_REFLECTANCE} );`;

/** three.js' own function leaves coat and sheen in its global variables; the base layer is ours. */
const COATS = `#if defined( USE_CLEARCOAT ) || defined( USE_SHEEN )
    ReflectedLight base = reflectedLight;
    RE_Direct_Physical( directLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, base );
  #endif`;

/** Takes the place of three.js' own function of a light. */
const DIRECT_LIGHT = "#undef RE_Direct\n#define RE_Direct lightwellDirect";

const SHADOW_OFFSET = `
#ifdef USE_SHADOWMAP
  ${SHADOW_LIFT}
  #if NUM_POINT_LIGHT_SHADOWS > 0
    uniform mat4 pointShadowMatrix[ NUM_POINT_LIGHT_SHADOWS ];
    vec4 lightwellPointShadow( mat4 toLight, vec3 point, vec3 facet, vec2 size ) {
      vec3 toPoint = ( toLight * vec4( point, 1.0 ) ).xyz;
      vec3 reach = abs( toPoint );
      float texel = 2.0 * max( max( reach.x, reach.y ), reach.z ) / size.x;
      return vec4( toPoint + lightwellLift( faceforward( facet, toPoint, facet ), normalize( toPoint ), texel, 0.5 ), 1.0 );
    }
  #endif
  #if NUM_DIR_LIGHT_SHADOWS > 0
    ${SUN_EDGE}
    uniform mat4 directionalShadowMatrix[ NUM_DIR_LIGHT_SHADOWS ];
    vec4 lightwellSunShadow( mat4 toMap, vec3 point, vec3 facet, vec3 toSun, vec2 size ) {
      vec3 ray = - ( vec4( toSun, 0.0 ) * viewMatrix ).xyz;
      return toMap * vec4( point + lightwellSunLift( facet, ray, lightwellTexel( toMap, size.x ) ), 1.0 );
    }
  #endif
#endif`;

/** World point, and normal of the triangle; derivatives must be taken outside of branches. */
const FACET = `
  vec3 lwPosition = cameraPosition - ( vec4( vLightwellToEye, 0.0 ) * viewMatrix ).xyz;
  vec3 lwFacet = cross( dFdx( vViewPosition ), dFdy( vViewPosition ) );
  lwFacet = normalize( ( vec4( lwFacet, 0.0 ) * viewMatrix ).xyz );
`;

/**
 * Point of the shadow test. Without centroids the point of a triangle's rim may lie beyond it, behind the next wall, in light that is not there:
 * it is drawn towards the eye, by three quarters of what a pixel is long there.
 */
const COVERED = "vec3 lwTested = lwPosition;";
const UNCOVERED = `vec3 lwTested = lwPosition + 0.75 * length( fwidth( vLightwellToEye ) ) * normalize( ( vec4( vLightwellToEye, 0.0 ) * viewMatrix ).xyz );`;

const SUN = "directionalLightShadow.shadow";

/** What takes the place of parts of three's light loop: the shadow coordinates of its vertex shader, and what a sun's filter counts for. */
const SHADOWS = [
  ["vPointShadowCoord[ i ]", "lightwellPointShadow( pointShadowMatrix[ i ], lwTested, lwFacet, pointLightShadow.shadowMapSize )"],
  ["getShadow( directionalShadowMap", "lightwellSunLight( getShadow( directionalShadowMap"],
  [
    "vDirectionalShadowCoord[ i ] )",
    `lightwellSunShadow( directionalShadowMatrix[ i ], lwTested, lwFacet, directLight.direction, ${SUN}MapSize ) ), lightwellTexel( directionalShadowMatrix[ i ], ${SUN}MapSize.x ), 1.0 - ${SUN}Intensity )`,
  ],
] as const;

/** Three's light loop with our shadows. */
function offsetShadows(chunk: string, centroids: boolean): string {
  return FACET + (centroids ? COVERED : UNCOVERED) + SHADOWS.reduce((text, [part, ours]) => replacePart(text, part, ours), chunk);
}
