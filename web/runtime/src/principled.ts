/**
 * The path tracer's surface model for the rasterised light: Burley's "principled" BSDF (SIGGRAPH 2012 course notes) as
 * Mitsuba 3 evaluates it, isotropic and opaque. Symbols: n normal, v to the eye, l to the light, h halfway vector,
 * α = roughness², η index of refraction, F₀ reflectance at normal incidence.
 *
 *     f = (1 − m) c/π [(1 − ½Sᵥ)(1 − ½Sₗ) + R(Sᵥ + Sₗ + SᵥSₗ(R − 1))] + D G F / (4 n·v n·l),
 *     S(x) = (1 − n·x)⁵,  R = 2 roughness (h·v)²,  F = (1 − m) F_dielectric(η) + m (c + (1 − c)(1 − h·v)⁵)
 *
 * The text needs nothing of three.js but the structures of its parameters, so that shaders of other engines can have it.
 *
 * A material without any specular reflectance (F₀ = 0) and metal is Lambertian: f = c/π.
 *
 * Args: GLSL statements that evaluate the layers above. Returns GLSL of `lightwellDirect`.
 */
export const principledLight = (coats = ""): string => /* glsl */ `
const float LIGHTWELL_MATTE = 1e-5;
const float LIGHTWELL_INVERSE_PI = 0.3183098861837907;

float lightwellSchlick( float cosine ) {
  float m = clamp( 1.0 - cosine, 0.0, 1.0 );
  return m * m * m * m * m;
}

float lightwellFresnel( float f0, float cosine ) {
  float eta = ( 1.0 + sqrt( f0 ) ) / max( 1.0 - sqrt( f0 ), 1e-3 );
  float g = sqrt( max( eta * eta - 1.0 + cosine * cosine, 0.0 ) );
  float a = ( g - cosine ) / ( g + cosine );
  float b = ( cosine * ( g + cosine ) - 1.0 ) / ( cosine * ( g - cosine ) + 1.0 );
  return 0.5 * a * a * ( 1.0 + b * b );
}

float lightwellSmith( float alpha2, float cosine ) {
  return 2.0 / ( 1.0 + sqrt( 1.0 + alpha2 * ( 1.0 - cosine * cosine ) / ( cosine * cosine ) ) );
}

void lightwellDirect( const in IncidentLight directLight, const in vec3 geometryPosition, const in vec3 geometryNormal,
    const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in PhysicalMaterial material,
    inout ReflectedLight reflectedLight ) {
  ${coats}
  float nl = dot( geometryNormal, directLight.direction );
  if ( nl <= 0.0 ) return;
  vec3 irradiance = nl * directLight.color;
  vec3 h = normalize( directLight.direction + geometryViewDir );
  float nv = max( dot( geometryNormal, geometryViewDir ), 1e-3 );
  float hv = clamp( dot( h, geometryViewDir ), 0.0, 1.0 );
  float nh = clamp( dot( geometryNormal, h ), 0.0, 1.0 );
  float f0 = max( max( material.specularColor.r, material.specularColor.g ), material.specularColor.b );
  float retro = 2.0 * material.roughness * hv * hv;
  float sv = lightwellSchlick( nv ), sl = lightwellSchlick( nl );
  float shape = ( 1.0 - 0.5 * sv ) * ( 1.0 - 0.5 * sl ) + retro * ( sv + sl + sv * sl * ( retro - 1.0 ) );
  if ( f0 < LIGHTWELL_MATTE ) shape = 1.0;
  reflectedLight.directDiffuse += irradiance * LIGHTWELL_INVERSE_PI * material.diffuseContribution * shape;
  float alpha = max( material.roughness * material.roughness, 1e-3 );
  float alpha2 = alpha * alpha;
  float d = nh * nh * ( alpha2 - 1.0 ) + 1.0;
  float lobe = alpha2 * LIGHTWELL_INVERSE_PI / ( d * d ) * lightwellSmith( alpha2, nl ) * lightwellSmith( alpha2, nv ) / ( 4.0 * nv * nl );
  float dielectric = f0 < LIGHTWELL_MATTE ? 0.0 : lightwellFresnel( f0, hv );
  vec3 metal = mix( material.diffuseColor, vec3( 1.0 ), lightwellSchlick( hv ) );
  reflectedLight.directSpecular += irradiance * lobe * mix( vec3( dielectric ), metal, material.metalness );
}
`;
