/**
 * Learned light at half the width and height, brought back by a joint bilateral filter: Kopf et al., Joint Bilateral
 * Upsampling, 2007. The light is demodulated, so textures stay as sharp as they are; only the learned part softens.
 */

import type { FieldProgram } from "./field-program.ts";
import { HalfTarget, LEAST_WEIGHT, NORMAL_COSINES, PLANE_SHARE } from "./half-target.ts";
import { lampsOf, radianceFunction, type SceneUniforms, SURFACE_ARGUMENTS, type SurfaceFinish, uniformsOf } from "./surface-finish.ts";

/** The small picture of `WebGLRenderer`. */
export class HalfResolution extends HalfTarget {
  readonly uniforms = {
    lightwellHalfLight: { value: this.light },
    lightwellHalfSurface: { value: this.surface },
    lightwellHalfScale: { value: this.scale },
    lightwellUnproject: { value: this.unproject },
  };
}

/** Demodulated learned light alone, and the surface's normal and depth in a second target. */
export function indirectFinish(key: string, fields: readonly FieldProgram[], scene: SceneUniforms): SurfaceFinish {
  return {
    key: () => `${key}:${lampsOf(fields)}`,
    uniforms: () => uniformsOf(fields, scene),
    environment: false,
    readsUv: fields.some((field) => field.readsUv),
    functions: () => `layout( location = 1 ) out highp vec4 lightwellSurface;\n${radianceFunction(fields)}`,
    statements: `
  outgoingLight = lightwellRadiance( ${SURFACE_ARGUMENTS} );
  lightwellSurface = vec4( lwNormal, vLightwellToEye.z );`,
  };
}

/** Rasterised light plus the small picture's learned light times the surface's reflectance. */
export function upsampledFinish(half: HalfResolution, scene: SceneUniforms, environment: boolean): SurfaceFinish {
  return {
    key: () => `upsampled:${environment ? "environment" : ""}`,
    uniforms: () => ({ ...half.uniforms, ...scene }),
    environment,
    readsUv: false,
    functions: () => `uniform float lightwellRaster;\n${UPSAMPLE}`,
    statements: `outgoingLight = lightwellRaster * outgoingLight + lwReflectance * lightwellUpsampled( lwNormal, lwFacet );`,
  };
}

/** Four taps around the pixel; a tap counts as far as it lies on the pixel's tangent plane and faces as the pixel does. */
/**
 * `lightwellDisagreement`: how little a tap agrees, as the distance from the tangent plane in units of what counts, and
 * 1 − cosine; huge for the void. Where no tap agrees (a thing too thin for the small picture, a rim), the one of a wider
 * neighbourhood that agrees best is taken.
 */
const UPSAMPLE = `
uniform sampler2D lightwellHalfLight;
uniform sampler2D lightwellHalfSurface;
uniform vec2 lightwellHalfScale;
uniform vec4 lightwellUnproject;

vec2 lightwellDisagreement( ivec2 tap, vec3 normal, vec3 plane ) {
  vec4 surface = texelFetch( lightwellHalfSurface, tap, 0 );
  if ( surface.w <= 0.0 ) return vec2( 1e9 );
  vec2 ndc = 2.0 * ( vec2( tap ) + 0.5 ) / vec2( textureSize( lightwellHalfSurface, 0 ) ) - 1.0;
  vec3 point = vec3( ndc * lightwellUnproject.xy + lightwellUnproject.zw, - 1.0 ) * surface.w;
  float reach = ${PLANE_SHARE} * vLightwellToEye.z;
  return vec2( abs( dot( plane, point + vLightwellToEye ) ) / reach, 1.0 - dot( normal, surface.xyz ) );
}

vec3 lightwellUpsampled( vec3 normal, vec3 facet ) {
  vec3 plane = ( viewMatrix * vec4( facet, 0.0 ) ).xyz;
  vec2 at = gl_FragCoord.xy * lightwellHalfScale - 0.5;
  ivec2 low = ivec2( floor( at ) ), last = textureSize( lightwellHalfLight, 0 ) - 1;
  vec2 share = at - floor( at );
  vec4 sum = vec4( 0.0 );
  for ( int i = 0; i < 4; i ++ ) {
    ivec2 corner = ivec2( i & 1, i >> 1 );
    ivec2 tap = clamp( low + corner, ivec2( 0 ), last );
    vec2 off = lightwellDisagreement( tap, normal, plane );
    vec2 linear = mix( 1.0 - share, share, vec2( corner ) );
    float weight = linear.x * linear.y * max( 1.0 - off.x * off.x, 0.0 )
      * smoothstep( ${NORMAL_COSINES.map((c) => c.toFixed(2)).join(", ")}, 1.0 - off.y );
    sum += weight * vec4( texelFetch( lightwellHalfLight, tap, 0 ).rgb, 1.0 );
  }
  if ( sum.w > ${LEAST_WEIGHT} ) return sum.rgb / sum.w;
  vec3 light = vec3( 0.0 );
  float best = 1e8;
  for ( int i = 0; i < 16; i ++ ) {
    ivec2 tap = clamp( low + ivec2( i & 3, i >> 2 ) - 1, ivec2( 0 ), last );
    vec2 off = lightwellDisagreement( tap, normal, plane );
    if ( off.x + 10.0 * off.y >= best ) continue;
    best = off.x + 10.0 * off.y;
    light = texelFetch( lightwellHalfLight, tap, 0 ).rgb;
  }
  return light;
}`;
