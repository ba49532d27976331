/** Where the shadow of a point is tested. */

/** Radius of the percentage-closer filter in shadow-map texels. */
export const SHADOW_RADIUS = 1.5;

/**
 * The shadow test happens at a point lifted off the facet, just far enough that the filter's
 * kernel of `radius` texels cannot dip below the facet: texel · (radius + 1) · sin θ. The facet's own normal and its
 * side are taken from derivatives, so thin two-sided sheets and smooth-shaded coarse meshes behave alike. For a lamp it is
 * lifted to the side of the light; for a sun to that of the eye, so that a side in its own shadow has none of the light that normal maps
 * turn to. It is also lifted some texels `along` the ray, for the wall that meets it in a corner: half a texel, but none where a sun's edge is strict, whose
 * light would come through the sheet above it.
 */
export const SHADOW_LIFT = /* glsl */ `
  vec3 lightwellLift( vec3 facet, vec3 rayToPoint, float texel, float along ) {
    float cosine = dot( facet, rayToPoint );
    float sine = sqrt( max( 1.0 - cosine * cosine, 0.0 ) );
    return texel * ( facet * ${(SHADOW_RADIUS + 1).toFixed(2)} * max( sine, 0.25 ) - along * rayToPoint );
  }`;

/**
 * How steeply a sun's light comes up with the share of the filter that is lit. At the foot of a wall of no thickness half of the filter
 * looks past the wall, and what is behind the wall must have no light of that: the last fourth alone counts, and shadows grow by about a texel.
 * So do those of lit walls that meet: where texels are longer than a few centimetres, out of doors, that would be seen, and all of it counts.
 */
export const STRICT = 4;
/** Length of a texel at which all of the filter counts, metres. */
export const COARSE = 0.04;

/** GLSL of a sun's edge, of a matrix from the world to the map and the map's edge in texels; and of the light that comes through its filter. */
export const SUN_EDGE = /* glsl */ `
  float lightwellTexel( mat4 toMap, float size ) { return 1.0 / ( length( vec3( toMap[ 0 ].x, toMap[ 1 ].x, toMap[ 2 ].x ) ) * size ); }
  float lightwellEdge( float texel ) { return clamp( ${COARSE} / texel, 1.0, ${STRICT}.0 ); }
  vec3 lightwellSunLift( vec3 facet, vec3 ray, float texel ) {
    return lightwellLift( facet, ray, texel, ( ${STRICT}.0 - lightwellEdge( texel ) ) / ${2 * (STRICT - 1)}.0 );
  }
  float lightwellSunLight( float share, float texel, float least ) { return max( 1.0 - ( 1.0 - share ) * lightwellEdge( texel ), least ); }`;
