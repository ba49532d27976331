/** Where the shadow of a point is tested. */

/** Radius of the percentage-closer filter in shadow-map texels. */
export const SHADOW_RADIUS = 1.5;

/**
 * The shadow test happens at a point lifted off the facet, towards the light, just far enough that the filter's
 * kernel of `radius` texels cannot dip below the facet: texel · (radius + 1) · sin θ, and half a texel towards the
 * light, for the wall that meets it in a corner. The facet's own normal and its
 * side are taken from derivatives, so thin two-sided sheets and smooth-shaded coarse meshes behave alike.
 */
export const SHADOW_LIFT = /* glsl */ `
  vec3 lightwellLift( vec3 facet, vec3 rayToPoint, float texel ) {
    float cosine = dot( facet, rayToPoint );
    float sine = sqrt( max( 1.0 - cosine * cosine, 0.0 ) );
    return - 0.5 * texel * rayToPoint + facet * ( cosine > 0.0 ? - texel : texel ) * ${(SHADOW_RADIUS + 1).toFixed(2)} * max( sine, 0.25 );
  }`;
