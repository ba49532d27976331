/** GLSL that tests shadows of declared lights against maps of distances, which engines draw. */

import { SHADOW_LIFT, SHADOW_RADIUS, SUN_EDGE } from "../shadow-lift.ts";

/** How many places of a map a test looks at. */
const TAPS = 5;

/** What all tests of a shader share. */
export const SHADOW_TAPS = /* glsl */ `
${SHADOW_LIFT}
${SUN_EDGE}
vec2 lightwellTap( int tap ) {
  float turn = 2.399963229728653 * float( tap ) + 6.283185307179586 * fract( 52.9829189 * fract( dot( gl_FragCoord.xy, vec2( 0.06711056, 0.00583715 ) ) ) );
  return sqrt( ( float( tap ) + 0.5 ) / ${TAPS}.0 ) * vec2( cos( turn ), sin( turn ) );
}`;

/**
 * GLSL of `lightwellShadow<index>` for a point light.
 *
 * Args: number of the lamp; GLSL of the light's place in the world, of the map's edge in texels, and of the distance in the world that
 * the map holds in a `direction`.
 */
export function pointShadow(index: number, place: string, size: string, stored: string): string {
  return /* glsl */ `
float lightwellShadow${index}( LightwellSurface s ) {
  vec3 ray = s.place - ${place};
  vec3 reach = abs( ray );
  float texel = 2.0 * max( max( reach.x, reach.y ), reach.z ) / ${size};
  ray += lightwellLift( faceforward( s.facet, ray, s.facet ), normalize( ray ), texel, 0.5 );
  float far = length( ray );
  vec3 ahead = ray / far;
  vec3 side = normalize( cross( ahead, abs( ahead.x ) > abs( ahead.z ) ? vec3( 0.0, 1.0, 0.0 ) : vec3( 1.0, 0.0, 0.0 ) ) );
  vec3 up = cross( ahead, side );
  float lit = 0.0;
  for ( int tap = 0; tap < ${TAPS}; tap ++ ) {
    vec2 at = lightwellTap( tap ) * ${SHADOW_RADIUS.toFixed(1)} / ${size};
    vec3 direction = ahead + side * at.x + up * at.y;
    lit += step( far, ${stored} );
  }
  return lit / ${TAPS}.0;
}`;
}

/**
 * GLSL of `lightwellShadow<index>` for a sun.
 *
 * Args: number of the lamp; GLSL of the matrix from the world to the map (x, y and depth from 0 to 1), of the direction to the sun in
 * the world, of the map's edge in texels, and of the depth that the map holds at `uv`.
 */
export function sunShadow(index: number, toMap: string, toSun: string, size: string, stored: string): string {
  return /* glsl */ `
float lightwellShadow${index}( LightwellSurface s ) {
  float texel = lightwellTexel( ${toMap}, ${size} );
  vec3 at = ( ${toMap} * vec4( s.place + lightwellSunLift( faceforward( s.facet, - ${toSun}, s.facet ), - ${toSun}, texel ), 1.0 ) ).xyz;
  if ( any( lessThan( at, vec3( 0.0 ) ) ) || any( greaterThan( at, vec3( 1.0 ) ) ) ) return 1.0;
  float lit = 0.0;
  for ( int tap = 0; tap < ${TAPS}; tap ++ ) {
    vec2 uv = at.xy + lightwellTap( tap ) * ${SHADOW_RADIUS.toFixed(1)} / ${size};
    lit += step( at.z, ${stored} );
  }
  return lightwellSunLight( lit / ${TAPS}.0, texel, 0.0 );
}`;
}
