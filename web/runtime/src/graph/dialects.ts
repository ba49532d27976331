/** Shading languages of engines, beside GLSL ES 3.00 and WGSL: HLSL, the Metal shading language, Godot's. */

import { GLSL, type Language, type ScalarType } from "./language.ts";

export type DialectName = "hlsl" | "msl" | "gdshader";

/** A language, and how its functions get at textures. */
export interface Dialect extends Language {
  readonly name: DialectName;
  /** What the declaration of a function begins with. */
  readonly linkage: string;
  /** A parameter that is an array of vec4, which is only read. */
  arrayParameter(name: string, count: number): string;
  /** Declaration of a texture of numbers: a uniform, or a parameter of the function. */
  texels(name: string): string;
  /** Declarations of a picture and its sampler. */
  picture(name: string, mips: boolean): readonly string[];
  /** Whether textures are parameters of the function, because the language has no globals for them or each engine its own. */
  readonly passesTextures: boolean;
  /** Line that defines how a texel is read by its number. */
  readTexel(read: string, texture: string, width: number): string;
}

const SHORT_TYPES: Record<ScalarType, string> = {
  float: "float",
  int: "int",
  uint: "uint",
  vec2: "float2",
  vec3: "float3",
  vec4: "float4",
  ivec2: "int2",
  ivec4: "int4",
};

/** What HLSL and MSL share. */
const SHORT: Language = {
  ...GLSL,
  type: (type) => SHORT_TYPES[type],
  constant: (type, name, value) => `${SHORT_TYPES[type]} ${name} = ${value};`,
  variable: (type, name, value) => `${SHORT_TYPES[type]} ${name} = ${value};`,
  array: (name, count) => `float4 ${name}[${count}];`,
  table: (type, name, values) => `${SHORT_TYPES[type]} ${name}[${values.length}] = { ${values.join(", ")} };`,
};

function shortFunction(linkage: string): Language["function"] {
  return (type, name, parameters, body) => {
    const list = parameters.map(([t, n]) => `${SHORT_TYPES[t]} ${n}`).join(", ");
    return `${linkage}${SHORT_TYPES[type]} ${name}(${list}) {\n${body.map((s) => `  ${s}\n`).join("")}}`;
  };
}

const slopeWith =
  (x: string, y: string): NonNullable<Language["slope"]> =>
  (at, size) => {
    const [dx, dy] = [`${x}(${at}) * ${size}`, `${y}(${at}) * ${size}`];
    return `float2(dot(${dx}, ${dx}), dot(${dy}, ${dy}))`;
  };

const HLSL: Dialect = {
  ...SHORT,
  name: "hlsl",
  linkage: "",
  // A constructor needs as many numbers as components.
  splat: (type, value) => `(${SHORT_TYPES[type]})(${value})`,
  mix: "lerp",
  sample: (name, at, level) => `${name}.SampleLevel(${name}_sampler, ${at}, ${level})`,
  slope: slopeWith("ddx", "ddy"),
  // A matrix literal of HLSL is given by rows: the transpose, with the vector on its left.
  transform: (columns, vector) => `mul(${vector}, float4x4(${columns.join(", ")}))`,
  function: shortFunction(""),
  arrayParameter: (name, count) => `float4 ${name}[${count}]`,
  texels: (name) => `Texture2D<float4> ${name}`,
  picture: (name) => [`Texture2D<float4> ${name}`, `SamplerState ${name}_sampler`],
  passesTextures: true,
  readTexel: (read, texture, width) =>
    `#define ${read}(i) ${texture}.Load(int3((i) & ${width - 1}, (i) >> ${Math.log2(width)}, 0))`,
};

const MSL: Dialect = {
  ...SHORT,
  name: "msl",
  linkage: "static ",
  splat: (type, value) => `${SHORT_TYPES[type]}(${value})`,
  sample: (name, at, lod) => `${name}.sample(${name}_sampler, ${at}, metal::level(${lod}))`,
  slope: slopeWith("dfdx", "dfdy"),
  transform: (columns, vector) => `float4x4(${columns.join(", ")}) * ${vector}`,
  function: shortFunction("static "),
  arrayParameter: (name) => `thread const float4* ${name}`,
  texels: (name) => `texture2d<float> ${name}`,
  picture: (name) => [`texture2d<float> ${name}`, `sampler ${name}_sampler`],
  passesTextures: true,
  readTexel: (read, texture, width) =>
    `#define ${read}(i) ${texture}.read(uint2((i) & ${width - 1}, (i) >> ${Math.log2(width)}), 0)`,
};

const GDSHADER: Dialect = {
  ...GLSL,
  name: "gdshader",
  linkage: "",
  // Both sides of a shift have the same type.
  places: "",
  table: (type, name, values) => `${type} ${name}[${values.length}] = { ${values.join(", ")} };`,
  arrayParameter: (name, count) => `vec4 ${name}[${count}]`,
  texels: (name) => `uniform sampler2D ${name} : filter_nearest, repeat_disable`,
  picture: (name, mips) => [`uniform sampler2D ${name} : filter_linear${mips ? "_mipmap" : ""}, repeat_disable`],
  passesTextures: false,
  readTexel: (read, texture, width) =>
    `vec4 ${read}(int i) { return texelFetch(${texture}, ivec2(i & ${width - 1}, i >> ${Math.log2(width)}), 0); }`,
};

export const DIALECTS: Readonly<Record<DialectName, Dialect>> = { hlsl: HLSL, msl: MSL, gdshader: GDSHADER };
