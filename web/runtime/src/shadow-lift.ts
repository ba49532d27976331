/** Where the shadow of a point is tested. */

/** Radius of the percentage-closer filter in shadow-map texels. */
export const SHADOW_RADIUS = 1.5;

/**
 * The shadow test happens at a point lifted off the facet, towards the light, just far enough that the filter's
 * kernel of `radius` texels cannot dip below the facet: texel · (radius + 1) · sin θ. The facet's own normal and its
 * side are taken from derivatives, so thin two-sided sheets and smooth-shaded coarse meshes behave alike. A lamp's is also
 * lifted half a texel along the ray, for the wall that meets it in a corner; a sun's would come through the sheet above it.
 */
export const SHADOW_LIFT = /* glsl */ `
  vec3 lightwellLift( vec3 facet, vec3 rayToPoint, float texel ) {
    float cosine = dot( facet, rayToPoint );
    float sine = sqrt( max( 1.0 - cosine * cosine, 0.0 ) );
    return facet * ( cosine > 0.0 ? - texel : texel ) * ${(SHADOW_RADIUS + 1).toFixed(2)} * max( sine, 0.25 );
  }
  vec3 lightwellLampLift( vec3 facet, vec3 rayToPoint, float texel ) {
    return lightwellLift( facet, rayToPoint, texel ) - 0.5 * texel * rayToPoint;
  }`;

/**
 * How steeply a sun's light comes up where the last share of the filter, one over this, is lit: at the foot of a wall of no thickness half
 * of the filter looks past the wall, and what is behind the wall must have no light of that. Shadows grow by about a texel.
 */
export const SUN_EDGE = 4;

/** GLSL of the light that comes through a sun's filter, from 1 to what is `least`. */
export const sunLight = (share: string, least = "0.0"): string => `max( ${SUN_EDGE}.0 * ${share} - ${SUN_EDGE - 1}.0, ${least} )`;
