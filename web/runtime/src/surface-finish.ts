/** What a surface shows: GLSL that is added to the shaders of three.js' standard and physical materials. */

import type { IUniform, Matrix4 } from "three";
import type { FieldProgram } from "./field-program.ts";

/** One way to finish a surface. */
export interface SurfaceFinish {
  /** Names the program; equal for materials that may share one. */
  key(): string;
  /** Asked for whenever a program is compiled: a field may have more uniforms for more lamps. */
  uniforms(): Readonly<Record<string, IUniform>>;
  /** Whether the functions read `vLightwellUv`. */
  readonly readsUv: boolean;
  /** Whether three.js adds the light of an environment map; learned light has it already. */
  readonly environment: boolean;
  /** GLSL before `main`. */
  functions(): string;
  /**
   * GLSL statements that set `outgoingLight`, which holds the rasterised light. In scope: `lwPosition`, `lwNormal`,
   * `lwFacet`, `lwView`, `lwBent` (world, units), `lwReflectance`, `roughnessFactor`, `metalnessFactor`; `lightwellToRoot`
   * is the matrix from the world to the space in which fields were learned, `lightwellToRest` from there to where the surface rests.
   */
  readonly statements: string;
}

/** Parameters of a GLSL function of a surface, and what they are given. */
export const SURFACE_PARAMETERS =
  "vec3 position, vec3 normal, vec3 shading_normal, vec3 view, vec3 reflectance, float roughness, float metallic, vec3 rest_position, vec3 rest_normal";
const direction = (name: string) => `normalize( mat3( lightwellToRoot ) * ${name} )`;
export const SURFACE_ARGUMENTS = [
  "( lightwellToRoot * vec4( lwPosition, 1.0 ) ).xyz",
  ...["lwNormal", "lwBent", "lwView"].map(direction),
  "lwReflectance, roughnessFactor, metalnessFactor",
  "( lightwellToRest * ( lightwellToRoot * vec4( lwPosition, 1.0 ) ) ).xyz",
  "normalize( mat3( lightwellToRest ) * ( mat3( lightwellToRoot ) * lwNormal ) )",
].join(", ");

/** Uniforms of fields, and what else a finish needs. */
export function uniformsOf(
  fields: readonly FieldProgram[],
  own: Readonly<Record<string, IUniform>> = {},
): Record<string, IUniform> {
  return Object.assign({}, own, ...fields.map((field) => field.uniforms));
}

/** GLSL that declares the texture coordinates that fields read. */
export function uvOf(fields: readonly FieldProgram[]): string {
  return `vec4 uv = ${fields.some((field) => field.readsUv) ? "vLightwellUv" : "vec4( 0.0 )"};`;
}

/** `lightwellRadiance(...)`: the sum of all fields over all of their lamps, demodulated by the reflectance. */
export function radianceFunction(fields: readonly FieldProgram[]): string {
  const sums = fields.map((field) =>
    field.forEachLamp(`if ( gain != vec3( 0.0 ) ) sum += gain * max( ${field.call}, 0.0 );`),
  );
  return `
${fields.map((field) => field.code).join("\n")}
vec3 lightwellRadiance( ${SURFACE_PARAMETERS} ) {
  ${uvOf(fields)}
  vec3 sum = vec3( 0.0 );
  ${sums.join("\n  ")}
  return sum;
}`;
}

/** The numbers of lamps that fields are evaluated for: a part of a program's name. */
export function lampsOf(fields: readonly FieldProgram[]): string {
  return fields.map((field) => field.lamps).join();
}

/** What all finishes of a scene share. */
export interface SceneUniforms extends Readonly<Record<string, IUniform>> {
  /** Factor of the rasterised light. */
  readonly lightwellRaster: IUniform<number>;
  /** From the world to the space in which fields were learned. */
  readonly lightwellToRoot: IUniform<Matrix4>;
}

/** Rasterised light plus what `fields` add; `environment` keeps that of an environment map. */
export function learnedFinish(
  key: string,
  fields: readonly FieldProgram[],
  scene: SceneUniforms,
  environment: boolean,
): SurfaceFinish {
  return {
    key: () => `${key}:${lampsOf(fields)}:${environment ? "environment" : ""}`,
    uniforms: () => uniformsOf(fields, scene),
    environment,
    readsUv: fields.some((field) => field.readsUv),
    functions: () => `uniform float lightwellRaster;\n${radianceFunction(fields)}`,
    statements: `outgoingLight = lightwellRaster * outgoingLight + lwReflectance * lightwellRadiance( ${SURFACE_ARGUMENTS} );`,
  };
}
