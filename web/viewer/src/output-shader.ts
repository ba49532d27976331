/** GLSL of the last pass: choose what is shown, expose, tone map, encode, dither. */

import { TONE_MAPPING_TEXTS, type ToneMappingName } from "./tone-mapping.ts";

/** Values of the uniform `show`. */
export const SHOW = { learned: 0, reference: 1, difference: 2, split: 3, experts: 4, beside: 5, mean: 6 } as const;

/** Edge of the tiles over which the difference is averaged, in pixels of the reference: its noise is no error. */
export const DIFFERENCE_TILE = 4;

/** Least displayed value of the backdrop. */
const DARKEST = 0.032;

/** Relative errors from 1 % to 100 % are spread over the two arms of the difference scale. */
export const DIFFERENCE_RANGE = [0.01, 1] as const;

export const OUTPUT_VERTEX = /* glsl */ `
  out vec2 vUv;
  void main() {
    vUv = uv;
    gl_Position = vec4( position.xy, 0.0, 1.0 );
  }`;

/** Fragment shader for a tone curve. */
export function outputFragment(toneMapping: ToneMappingName): string {
  return /* glsl */ `
  precision highp sampler2D;
  #include <tonemapping_pars_fragment>
  uniform sampler2D total;      // learned picture, as large as the canvas; alpha is coverage
  uniform sampler2D picture;    // learned picture, as large as the reference
  uniform sampler2D beside;     // the scene with ordinary light maps, as large as the canvas
  uniform sampler2D reference;  // first row at v = 0
  uniform sampler2D mean;       // mean of displayed frames, as large as the canvas
  uniform vec4 frame;           // corner and size of the reference on the canvas, in its uv
  uniform int show;
  uniform float split;          // where the left picture ends, in u
  uniform float floorRadiance;  // added to the denominator of the relative error
  uniform float dither;
  in vec2 vUv;
  out vec4 color;

  vec3 display( vec3 radiance ) {
    return sRGBTransferOETF( vec4( ${TONE_MAPPING_TEXTS[toneMapping].glsl}( clamp( radiance, 0.0, 65000.0 ) ), 1.0 ) ).rgb;
  }

  vec3 backdrop( vec2 uv ) {
    float d = length( ( uv - vec2( 0.5, 0.55 ) ) * vec2( 1.1, 1.0 ) );
    return mix( vec3( 0.105, 0.108, 0.120 ), vec3( ${DARKEST}, 0.033, 0.038 ), smoothstep( 0.0, 0.85, d ) );
  }

  vec3 over( vec3 premultiplied, float coverage ) {
    return mix( backdrop( vUv ), display( premultiplied / max( coverage, 1e-4 ) ), coverage );
  }

  // too dark: blue; too bright: amber; right: near black
  vec3 errorColor( float error ) {
    float size = clamp( log2( abs( error ) / ${DIFFERENCE_RANGE[0]} ) / log2( float( ${DIFFERENCE_RANGE[1] / DIFFERENCE_RANGE[0]} ) ), 0.0, 1.0 );
    vec3 low = vec3( 0.055, 0.058, 0.066 );
    vec3 middle = error < 0.0 ? vec3( 0.10, 0.36, 0.80 ) : vec3( 0.82, 0.34, 0.07 );
    vec3 high = error < 0.0 ? vec3( 0.72, 0.92, 1.00 ) : vec3( 1.00, 0.93, 0.66 );
    return size < 0.5 ? mix( low, middle, size * 2.0 ) : mix( middle, high, size * 2.0 - 1.0 );
  }

  vec3 differenceColor( vec2 at ) {
    const vec3 luminance = vec3( 0.2126, 0.7152, 0.0722 );
    vec2 size = vec2( textureSize( reference, 0 ) );
    vec2 corner = floor( at * size / float( ${DIFFERENCE_TILE} ) ) * float( ${DIFFERENCE_TILE} );
    float truth = 0.0;
    float learned = 0.0;
    for ( int y = 0; y < ${DIFFERENCE_TILE}; y++ ) {
      for ( int x = 0; x < ${DIFFERENCE_TILE}; x++ ) {
        vec2 place = min( corner + vec2( x, y ) + 0.5, size - 0.5 ) / size;
        truth += dot( texture( reference, vec2( place.x, 1.0 - place.y ) ).rgb, luminance );
        learned += dot( texture( picture, place ).rgb, luminance );
      }
    }
    truth /= float( ${DIFFERENCE_TILE ** 2} );
    learned /= float( ${DIFFERENCE_TILE ** 2} );
    // Where both are nearly black no eye sees a difference: stripes.
    if ( max( truth, learned ) < floorRadiance ) {
      return vec3( 0.045 ) + 0.02 * step( 0.5, fract( ( gl_FragCoord.x + gl_FragCoord.y ) / 8.0 ) );
    }
    return errorColor( ( learned - truth ) / ( truth + floorRadiance ) );
  }

  // Of a pixel of the reference: at a silhouette that of the learned picture, because what is behind is black in the
  // reference; elsewhere that of what is not darker than the backdrop, such as glass, which the learned picture does not
  // cover. Denoised references have a trace of light around silhouettes.
  float covered( float drawn, vec3 truth ) {
    vec2 texel = frame.zw / vec2( textureSize( reference, 0 ) );
    float near = drawn;
    for ( int y = -2; y <= 2; y++ ) {
      for ( int x = -2; x <= 2; x++ ) near = max( near, texture( total, vUv + texel * vec2( x, y ) ).a );
    }
    return near > 0.0 ? drawn : float( any( greaterThan( display( truth ), vec3( ${DARKEST} ) ) ) );
  }

  float gradientNoise( vec2 p ) {
    return fract( 52.9829189 * fract( dot( p, vec2( 0.06711056, 0.00583715 ) ) ) );
  }

  void main() {
    vec4 learned = texture( total, vUv );
    vec2 at = ( vUv - frame.xy ) / frame.zw;
    bool inFrame = all( greaterThanEqual( at, vec2( 0.0 ) ) ) && all( lessThanEqual( at, vec2( 1.0 ) ) );
    if ( show == ${SHOW.beside} && vUv.x < split ) learned = texture( beside, vUv );
    vec3 shown = over( learned.rgb, learned.a );
    // Colours that mean something are shown as they are, whatever the exposure.
    if ( show == ${SHOW.experts} ) shown = mix( backdrop( vUv ), sRGBTransferOETF( learned / max( learned.a, 1e-4 ) ).rgb, learned.a );
    if ( show == ${SHOW.reference} || ( show == ${SHOW.split} && vUv.x < split ) ) {
      vec3 truth = texture( reference, vec2( at.x, 1.0 - at.y ) ).rgb;
      float coverage = covered( learned.a, truth );
      shown = inFrame ? over( truth, coverage ) : backdrop( vUv );
    } else if ( show == ${SHOW.difference} ) {
      shown = inFrame ? differenceColor( at ) : backdrop( vUv );
    }
    if ( show == ${SHOW.mean} ) shown = texture( mean, vUv ).rgb;
    color = vec4( shown + dither * ( gradientNoise( gl_FragCoord.xy ) - 0.5 ) / 255.0, 1.0 );
  }`;
}
