/** The few ways in which shading languages differ, so that each op has one text. GLSL ES 3.00 and WGSL; others: `dialects.ts`. */

export type ScalarType = "float" | "int" | "uint" | "vec2" | "vec3" | "vec4" | "ivec2" | "ivec4";

export interface Language {
  readonly name: "glsl" | "wgsl" | "hlsl" | "msl" | "gdshader";
  /** Name of a type, also its constructor. */
  type(type: ScalarType): string;
  /** A vector whose components are all the same number. */
  splat(type: ScalarType, value: string): string;
  /** Name of the function that interpolates linearly. */
  readonly mix: "mix" | "lerp";
  /** What stands behind the number of places of a shift. */
  readonly places: "u" | "";
  /** Constant declaration. */
  constant(type: ScalarType, name: string, value: string): string;
  /** Variable declaration with a value. */
  variable(type: ScalarType, name: string, value: string): string;
  /** Local array of vec4, not initialised. */
  array(name: string, count: number): string;
  /** Local array of constants. */
  table(type: ScalarType, name: string, values: readonly string[]): string;
  /** Head of a loop over `name` from 0 to `count` − 1; the caller closes the brace. */
  loop(name: string, count: number): string;
  /** Filtered texel of a picture at a level, as a vec4. */
  sample(name: string, at: string, level: string): string;
  /** Squared length, in texels, of the steps to the next pixel along x and along y; absent outside of fragments. */
  readonly slope?: (at: string, size: string) => string;
  /** `condition ? yes : no`, for a scalar condition. */
  choose(condition: string, yes: string, no: string): string;
  /** A 4×4 matrix, given by its columns, times a vec4. */
  transform(columns: readonly string[], vector: string): string;
  /** A function whose body is given as lines. */
  function(
    type: ScalarType,
    name: string,
    parameters: readonly [ScalarType, string][],
    body: readonly string[],
  ): string;
}

export const GLSL: Language = {
  name: "glsl",
  type: (type) => type,
  splat: (type, value) => `${type}(${value})`,
  mix: "mix",
  places: "u",
  constant: (type, name, value) => `${type} ${name} = ${value};`,
  variable: (type, name, value) => `${type} ${name} = ${value};`,
  array: (name, count) => `vec4 ${name}[${count}];`,
  table: (type, name, values) =>
    `${type} ${name}[${values.length}] = ${type}[${values.length}](${values.join(", ")});`,
  loop: (name, count) => `for (int ${name} = 0; ${name} < ${count}; ${name}++) {`,
  sample: (name, at, level) => `textureLod(${name}, ${at}, ${level})`,
  slope: (at, size) => {
    const [x, y] = [`dFdx(${at}) * ${size}`, `dFdy(${at}) * ${size}`];
    return `vec2(dot(${x}, ${x}), dot(${y}, ${y}))`;
  },
  choose: (condition, yes, no) => `(${condition} ? ${yes} : ${no})`,
  transform: (columns, vector) => `mat4(${columns.join(", ")}) * ${vector}`,
  function: (type, name, parameters, body) =>
    `${type} ${name}(${parameters.map(([t, n]) => `${t} ${n}`).join(", ")}) {\n${body.map((s) => `  ${s}\n`).join("")}}`,
};

const WGSL_TYPES: Record<ScalarType, string> = {
  float: "f32",
  int: "i32",
  uint: "u32",
  vec2: "vec2f",
  vec3: "vec3f",
  vec4: "vec4f",
  ivec2: "vec2i",
  ivec4: "vec4i",
};

export const WGSL: Language = {
  name: "wgsl",
  type: (type) => WGSL_TYPES[type],
  splat: (type, value) => `${WGSL_TYPES[type]}(${value})`,
  mix: "mix",
  places: "u",
  constant: (_type, name, value) => `let ${name} = ${value};`,
  variable: (_type, name, value) => `var ${name} = ${value};`,
  array: (name, count) => `var ${name}: array<vec4f, ${count}>;`,
  table: (type, name, values) =>
    `var ${name} = array<${WGSL_TYPES[type]}, ${values.length}>(${values.join(", ")});`,
  loop: (name, count) => `for (var ${name} = 0i; ${name} < ${count}; ${name}++) {`,
  sample: (name, at, level) => `textureSampleLevel(${name}, ${name}_sampler, ${at}, ${level})`,
  choose: (condition, yes, no) => `select(${no}, ${yes}, ${condition})`,
  transform: (columns, vector) => `mat4x4f(${columns.join(", ")}) * ${vector}`,
  function: (type, name, parameters, body) =>
    `fn ${name}(${parameters.map(([t, n]) => `${n}: ${WGSL_TYPES[t]}`).join(", ")}) -> ${WGSL_TYPES[type]} {\n${body
      .map((s) => `  ${s}\n`)
      .join("")}}`,
};

/** Smallest normal 32-bit float: below it shaders may flush to zero, so literals do. */
const SMALLEST = 1.1754943508222875e-38;

const LARGEST = 3.4028234663852886e38;

/** A number as a float literal of all languages that reads back as the same 32-bit float. */
export function literal(x: number): string {
  const value = Math.fround(x);
  if (Math.abs(value) < SMALLEST) return "0.0";
  let text = String(value);
  for (let digits = 6; digits <= 9; digits++) {
    const short = String(Number(value.toPrecision(digits)));
    // A decimal that rounds to the largest float may itself be larger, which WGSL refuses.
    if (Math.fround(Number(short)) === value && Math.abs(Number(short)) <= LARGEST) {
      text = short;
      break;
    }
  }
  text = text.replace("e+", "e");
  return /[.e]/.test(text) ? text : `${text}.0`;
}
