/** The light of a file for engines other than three.js: lamps, fields, and the GLSL that shades a surface with both. */

import type { NeuralRadiance } from "../extension.ts";
import { MIN_REACH } from "../falloff.ts";
import type { TexelTexture } from "../graph/glsl.ts";
import type { StoredBuffer } from "../graph/stored.ts";
import { principledLight } from "../principled.ts";
import { EngineField, type NumberUniform } from "./engine-field.ts";
import { EngineLamp } from "./engine-lamp.ts";

/** Which parts of the light are shown. */
export interface EngineParts {
  /** Direct light of the lamps. */
  readonly raster: boolean;
  /** Learned light of the lamps. */
  readonly indirect: boolean;
  /** Learned light of the scene's own emitters. */
  readonly still: boolean;
}

/**
 * Lamps and fields of one file. An engine's adapter declares `uniforms`, binds `textures` and `pictures`, puts `code` before its
 * shader's `main`, and adds `lightwellShade( surface )` to the outgoing radiance.
 */
export class EngineLight {
  readonly lamps: readonly EngineLamp[];
  readonly fields: readonly EngineField[];
  /** All numbers that `code` reads beside the engine's own uniforms. */
  readonly uniforms: readonly NumberUniform[];
  private readonly shown = new Float32Array([1, 1, 1]);
  private readonly places: Float32Array<ArrayBuffer>;
  private readonly tints: Float32Array<ArrayBuffer>;
  /** What the scene's own lamps are multiplied by, as the file sets them: red of all groups, then green, then blue. */
  private readonly dimmers: readonly number[];

  constructor(radiance: NeuralRadiance, weights?: "inline" | "texture") {
    const sky = radiance.variables.find((variable) => variable.kind === "sun" && variable.sky !== null);
    if (sky) throw new Error(`sun '${sky.name}': expected one without a sky; show it with three.js`);
    const turning = radiance.variables.find(({ kind }) => kind === "environment");
    if (turning) throw new Error(`environment '${turning.name}': expected one that stands still; show it with three.js`);
    const [mover] = radiance.movers;
    if (mover) throw new Error(`${mover.kind} '${mover.name}': expected a scene that stands still; show it with three.js`);
    this.lamps = radiance.variables.map((variable) => new EngineLamp(variable));
    this.fields = radiance.fields.map((record, i) => new EngineField(record, i, record.variable < 0 ? [] : [record.variable], weights));
    const count = Math.max(this.lamps.length, 1);
    this.places = new Float32Array(3 * count);
    this.tints = new Float32Array(3 * count);
    this.dimmers = [0, 1, 2].flatMap((channel) => radiance.lamps.map(({ intensity, color }) => intensity * color[channel]!));
    this.uniforms = [
      { name: "lightwellShown", size: 3, values: this.shown, isArray: false },
      { name: "lightwellLamps", size: 3, values: this.places, isArray: true },
      { name: "lightwellTints", size: 3, values: this.tints, isArray: true },
      ...this.fields.flatMap((field) => field.uniforms),
    ];
    this.update();
  }

  get textures(): readonly TexelTexture[] {
    return this.fields.flatMap((field) => field.textures);
  }

  get pictures(): ReadonlyMap<string, StoredBuffer> {
    return new Map(this.fields.flatMap((field) => [...field.pictures]));
  }

  /** Choose which parts of the light are shown. */
  show({ raster, indirect, still }: EngineParts): void {
    this.shown.set([raster, indirect, still].map(Number));
  }

  /** Bring `uniforms` up to date with the lamps; call before drawing. */
  update(): void {
    for (const [i, { value, color, intensity }] of this.lamps.entries()) {
      this.places.set(value, 3 * i);
      this.tints.set(color.map((c) => c * intensity), 3 * i);
    }
    for (const field of this.fields) field.update(this.lamps.map((lamp) => lamp.value), this.dimmers);
  }

  /**
   * GLSL of everything, with uniforms. `shadows` holds `float lightwellShadow<i>( LightwellSurface s )` for each lamp of `shadowed`,
   * 1 where it shines.
   */
  code(shadows: string, shadowed: ReadonlySet<number>): string {
    const count = Math.max(this.lamps.length, 1);
    const direct = this.lamps.map((lamp, i) => directOf(i, lamp, shadowed.has(i)));
    return `${SURFACE}
uniform vec3 lightwellShown;
uniform vec3 lightwellLamps[ ${count} ];
uniform vec3 lightwellTints[ ${count} ];
${this.fields.map((field) => field.code).join("\n")}
${principledLight()}
${shadows}
vec3 lightwellDirectLight( LightwellSurface s ) {
  PhysicalMaterial m = PhysicalMaterial( s.base, s.base * ( 1.0 - s.metallic ), s.specular, s.glossiness, s.metallic );
  ReflectedLight sum = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ) );
  ${direct.join("\n  ")}
  return sum.directDiffuse + sum.directSpecular;
}
vec3 lightwellLearned( LightwellSurface s ) {
  vec3 sum = vec3( 0.0 );
  ${this.fields.map((field) => field.statements).join("\n  ")}
  return s.reflectance * sum;
}
vec3 lightwellShade( LightwellSurface s ) {
  vec3 learned = lightwellLearned( s );
  return lightwellShown.x > 0.0 ? learned + lightwellDirectLight( s ) : learned;
}`;
  }
}

/** GLSL statements that add the direct light of a lamp. */
function directOf(index: number, { variable }: EngineLamp, shadowed: boolean): string {
  const shadow = shadowed ? `lightwellShadow${index}( s )` : "1.0";
  const toLight =
    variable.kind === "point"
      ? `vec3 to = lightwellLamps[ ${index} ] - s.position; float square = dot( to, to ); to *= inversesqrt( square );`
      : `vec3 to = lightwellLamps[ ${index} ]; float square = 1.0;`;
  return `{ ${toLight}
    IncidentLight light = IncidentLight( lightwellTints[ ${index} ] * ( ${shadow} / max( square, ${MIN_REACH} ) ), to );
    lightwellDirect( light, s.position, s.bent, s.view, s.bent, m, sum ); }`;
}

/**
 * What is known of a surface. In the space of the file: `position`, `normal` (on the side of the eye), `shading_normal` (the same after the
 * normal map), `bent` (as the engine lights it), `view`. In the world: `place`, `facet` (of the triangle, on the side of the eye).
 * `glossiness` is the roughness that highlights have, widened where the surface is curved; `uv`, `uv1` as in the file.
 */
const SURFACE = /* glsl */ `
struct IncidentLight { vec3 color; vec3 direction; };
struct ReflectedLight { vec3 directDiffuse; vec3 directSpecular; };
struct PhysicalMaterial { vec3 diffuseColor; vec3 diffuseContribution; vec3 specularColor; float roughness; float metalness; };
struct LightwellSurface {
  vec3 position; vec3 normal; vec3 shading_normal; vec3 bent; vec3 view;
  vec3 place; vec3 facet;
  vec3 base; vec3 specular; vec3 reflectance; float roughness; float metallic; float glossiness;
  vec2 uv; vec2 uv1;
};
LightwellSurface lightwellSurface( mat4 toFile, vec3 place, vec3 smoothNormal, vec3 bent, vec3 view, vec3 base, vec3 specular, float roughness, float metallic, mat3 toEye ) {
  LightwellSurface s;
  mat3 turn = mat3( toFile );
  vec3 facet = normalize( cross( dFdx( place ), dFdy( place ) ) );
  s.place = place;
  s.facet = dot( facet, view ) < 0.0 ? - facet : facet;
  s.position = ( toFile * vec4( place, 1.0 ) ).xyz;
  vec3 normal = dot( s.facet, smoothNormal ) < 0.0 ? - smoothNormal : smoothNormal;
  vec3 mapped = bent - min( 2.0 * dot( bent, normal ), 0.0 ) * normal;
  s.normal = normalize( turn * normal );
  s.shading_normal = normalize( turn * mapped );
  s.bent = normalize( turn * bent );
  s.view = normalize( turn * view );
  s.base = base;
  s.specular = specular;
  s.metallic = metallic;
  s.roughness = roughness;
  // three.js widens highlights of curved surfaces so.
  vec3 seen = toEye * smoothNormal;
  vec3 bend = max( abs( dFdx( seen ) ), abs( dFdy( seen ) ) );
  s.glossiness = min( max( roughness, 0.0525 ) + max( max( bend.x, bend.y ), bend.z ), 1.0 );
  s.reflectance = max( base + 0.04 * ( 1.0 - metallic ), 1e-3 );
  s.uv = vec2( 0.0 );
  s.uv1 = vec2( 0.0 );
  return s;
}`;
