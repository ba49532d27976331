/** A picture of a field's segmentation: a colour for every expert, striped where two of them share a point. */

import type { FieldProgram } from "./field-program.ts";
import { linearOf, SEGMENT_COLORS, STRIPE_PERIOD } from "./segment-colors.ts";
import {
  lampsOf,
  type SceneUniforms,
  SURFACE_ARGUMENTS,
  SURFACE_PARAMETERS,
  type SurfaceFinish,
  uniformsOf,
  uvOf,
} from "./surface-finish.ts";

/** Colours by number: the fixed ones, then hues a golden angle apart in OKLCH (Ottosson 2020) with three lightnesses. */
const SWATCH = `
vec3 lightwellSwatch( float segment ) {
  const vec3 fixedColors[ ${SEGMENT_COLORS.length} ] = vec3[ ${SEGMENT_COLORS.length} ]( ${SEGMENT_COLORS.map(linear).join(", ")} );
  int i = int( max( segment, 0.0 ) + 0.5 );
  if ( i < ${SEGMENT_COLORS.length} ) return fixedColors[ i ];
  float hue = 6.283185307 * fract( 0.6180339887 * float( i ) );
  float lightness = 0.60 + 0.10 * float( i % 3 );
  vec2 ab = 0.125 * vec2( cos( hue ), sin( hue ) );
  vec3 lms = lightness + mat2x3( 0.3963377774, - 0.1055613458, - 0.0894841775, 0.2158037573, - 0.0638541728, - 1.2914855480 ) * ab;
  lms = lms * lms * lms;
  return max( mat3( 4.0767416621, - 1.2684380046, - 0.0041960863, - 3.3077115913, 2.6097574011, - 0.7034186147,
    0.2309699292, - 0.3413193965, 1.7076147010 ) * lms, 0.0 );
}`;

/**
 * Stripes of the second colour, as wide as its share. The side with the lower number paints a stripe from its left, the
 * other one from its right, so that at equal shares, where the two change places, the pattern runs on.
 */
const STRIPES = `
float lightwellStripes( float share, bool lower ) {
  float phase = fract( ( gl_FragCoord.x + gl_FragCoord.y ) / ${STRIPE_PERIOD.toFixed(1)} );
  float middle = lower ? 0.5 * share : 1.0 - 0.5 * share;
  float away = abs( fract( phase - middle + 0.5 ) - 0.5 );
  return clamp( ( 0.5 * share - away ) * ${(STRIPE_PERIOD / 1.5).toFixed(2)} + 0.5, 0.0, 1.0 ) * min( share / 0.04, 1.0 );
}`;

/** Paints by segment, lit a little by the normal so that shapes can be read. The value is for the screen as it is. */
export function segmentFinish(key: string, field: FieldProgram, scene: SceneUniforms): SurfaceFinish {
  const has = (name: string) => field.graph.outputs.has(name);
  const read = (name: string, otherwise: string) => (has(name) ? field.output(name, "found") : otherwise);
  return {
    key: () => `${key}:${lampsOf([field])}`,
    uniforms: () => uniformsOf([field], scene),
    environment: false,
    readsUv: field.readsUv,
    functions: () => `${field.code}\n${SWATCH}\n${STRIPES}
vec3 lightwellSegments( ${SURFACE_PARAMETERS} ) {
  ${uvOf([field])}
  vec3 light = ${field.name}_light[ 0 ];
  ${field.type} found = ${field.call};
  float segment = ${read("segment", "0.0")}, share = ${read("overlap", "0.0")}, second = ${read("second", "- 1.0")};
  vec3 color = lightwellSwatch( segment );
  vec3 other = second < 0.0 ? 0.3 * color : lightwellSwatch( second );
  color = mix( color, other, lightwellStripes( share, segment < second ) );
  float sky = 0.5 + 0.5 * dot( normal, vec3( 0.37, 0.83, 0.41 ) );
  return color * ( 0.30 + 0.58 * sky + 0.12 * max( dot( normal, view ), 0.0 ) );
}`,
    statements: `outgoingLight = lightwellSegments( ${SURFACE_ARGUMENTS} );`,
  };
}

/** A colour as a GLSL literal in linear sRGB. */
function linear(hex: string): string {
  return `vec3( ${linearOf(hex).map((x) => x.toFixed(4)).join(", ")} )`;
}
