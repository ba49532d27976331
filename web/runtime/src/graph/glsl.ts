/** Prints a shading graph as GLSL ES 3.00. */

import { BUDGET } from "./budget.ts";
import type { FrameLayout } from "./frame.ts";
import type { Graph } from "./node.ts";
import { toHalf } from "./half.ts";
import { GLSL } from "./language.ts";
import type { StoredBuffer } from "./op.ts";
import type { Names, TexelStore } from "./printer.ts";
import { narrow, printProgram } from "./program.ts";

/** A texture of numbers, four a texel, to be read with `texelFetch`: nearest, no mipmaps, not sRGB. */
export interface TexelTexture {
  /** Name of the sampler uniform. */
  readonly name: string;
  readonly width: number;
  readonly height: number;
  readonly format: "rgba16float" | "rgba32float";
  /** Half floats as bits, or floats; row by row. */
  readonly data: Uint16Array<ArrayBuffer> | Float32Array<ArrayBuffer>;
}

/** What depends on the frame only: blocks to fill with `evaluateFrame` whenever its inputs change, light after light. */
export interface FrameUniform extends FrameLayout {
  /** Name of the uniform. */
  readonly name: string;
  /**
   * Up to `FRAME_UNIFORM_LIMIT` blocks of all lights it is `uniform vec4 name[lights * blocks]`, beyond an RGBA32F texture
   * with a row a light.
   */
  readonly kind: "array" | "texture";
  /** Global int variable that says for which light the function is evaluated; null when there is one light. */
  readonly slot: string | null;
}

export interface GlslProgram {
  /** Uniform declarations and functions, for a shader with `precision highp float`. */
  readonly code: string;
  /** `code` without the declarations of uniforms, for those who declare them under the same names. */
  readonly body: string;
  /** Type of the result: `float`, `vec2`, `vec3`, `vec4`, or a struct with `vec4 NAME[blocks]` per output. */
  readonly type: string;
  /** Inputs in the order of the function's parameters; those wider than 4 are arrays of vec4. */
  readonly parameters: readonly { readonly name: string; readonly width: number }[];
  readonly textures: readonly TexelTexture[];
  /** Pictures to be sampled, by the names of their samplers; the same in every program of the graph. */
  readonly pictures: ReadonlyMap<string, StoredBuffer>;
  readonly frame: FrameUniform | null;
}

export interface GlslOptions {
  /** Name of the function and prefix of everything else. */
  readonly name: string;
  /** `inline`: literals, for a few small networks. `texture`: loops over `texelFetch`. Tables and experts are always textures. */
  readonly weights: "inline" | "texture";
  /** How many sets of per-frame values there are, one a light; 1 unless given. */
  readonly lights?: number;
  /** Per-frame values in a texture, however few they are. */
  readonly frameTexture?: boolean;
  /** Most characters of the text; those of the default budget unless given. */
  readonly maxText?: number;
  /** Names of uniforms in `body` where the host gives them others than the program's own. */
  readonly names?: Names;
}

/** Blocks of per-frame values that still travel as a uniform array: WebGL2 guarantees 224 in all. */
export const FRAME_UNIFORM_LIMIT = 128;
/** Width and greatest height of a texel texture: what every WebGL2 device takes. */
const TEXTURE_SIDE = 2048;

/** Print a graph as `TYPE name(inputs…)`. */
export function printGlsl(graph: Graph, options: GlslOptions): GlslProgram {
  const { name, weights, lights = 1 } = options;
  const { printer, frame, parameters, outputs } = printProgram(graph, GLSL, {
    prefix: name,
    weights: weights === "inline" ? "inline" : "table",
    halfTexels: true,
    limit: options.maxText ?? BUDGET.text,
    ...(options.names ? { names: options.names } : {}),
  });
  const bound = (own: string) => printer.bound(own);
  const textures = [
    texelTexture(`${name}_full_texels`, printer.full),
    texelTexture(`${name}_half_texels`, printer.half),
  ].filter((t) => t !== null);
  const single = outputs.length === 1 && outputs[0]!.value.width <= 4;
  const type = single ? vector(outputs[0]!.value.width) : `${name}_result`;
  const types = parameters.map((p, i) =>
    p.width > 4 ? `vec4 i${i}[${Math.ceil(p.width / 4)}]` : `${vector(p.width)} i${i}`,
  );
  const result: string[] = [];
  if (single) result.push(`return ${narrow(outputs[0]!.value)};`);
  else {
    result.push(`${type} result;`);
    for (const [i, { value }] of outputs.entries()) {
      for (let b = 0; b < value.blocks; b++) result.push(`result.o${i}[${b}] = ${value.block(b)};`);
    }
    result.push("return result;");
  }
  const struct = `struct ${type} {\n${outputs
    .map(({ name: output, value }, i) => `  vec4 o${i}[${value.blocks}]; // ${output}\n`)
    .join("")}};`;
  const limit = options.frameTexture ? 0 : FRAME_UNIFORM_LIMIT;
  const uniform = frame.blocks ? frameUniform(name, frame, lights, limit) : null;
  const pictures = new Map([...printer.pictures].map(([buffer, sampler]) => [sampler, buffer]));
  const declarations = [
    ...[...textures.map((texture) => texture.name), ...pictures.keys()].map(
      (sampler) => `uniform highp sampler2D ${bound(sampler)};`,
    ),
    ...(uniform ? [declareFrame({ ...uniform, name: bound(uniform.name) }, lights)] : []),
  ];
  const body = [
    ...textures.map((texture) => readTexel(texture, bound(texture.name))),
    ...(uniform ? [readFrame({ ...uniform, name: bound(uniform.name) }, name)] : []),
    ...(single ? [] : [struct]),
    ...printer.helpers.values(),
    `${type} ${name}(${types.join(", ")}) {`,
    ...printer.lines,
    ...result.map((line) => `  ${line}`),
    "}",
  ].join("\n");
  return {
    code: [...declarations, body].join("\n"),
    body,
    type,
    parameters: parameters.map(({ name, width }) => ({ name, width })),
    textures,
    pictures,
    frame: uniform,
  };
}

function vector(width: number): string {
  return width === 1 ? "float" : `vec${width}`;
}

function readTexel({ name, width }: TexelTexture, sampler: string): string {
  const read = name.replace(/_texels$/, "");
  const shift = Math.log2(width);
  const at = `ivec2(i & ${width - 1}, i >> ${shift})`;
  return `vec4 ${read}(int i) { return texelFetch(${sampler}, ${at}, 0); }`;
}

function frameUniform(name: string, frame: FrameLayout, lights: number, limit: number): FrameUniform {
  const slot = lights > 1 ? `${name}_slot` : null;
  // Two names, so that a program for few lights and one for many can share a set of uniforms.
  return lights * frame.blocks <= limit
    ? { ...frame, name: `${name}_frame`, kind: "array", slot }
    : { ...frame, name: `${name}_frame_texels`, kind: "texture", slot };
}

function declareFrame({ name, kind, blocks }: FrameUniform, lights: number): string {
  return kind === "array" ? `uniform highp vec4 ${name}[${lights * blocks}];` : `uniform highp sampler2D ${name};`;
}

function readFrame({ name: uniform, kind, blocks, slot }: FrameUniform, name: string): string {
  const value =
    kind === "array"
      ? `${uniform}[${slot ? `${slot} * ${blocks} + i` : "i"}]`
      : `texelFetch(${uniform}, ivec2(i, ${slot ?? 0}), 0)`;
  const variable = slot ? `int ${slot} = 0;\n` : "";
  return `${variable}vec4 ${name}_frame_at(int i) { return ${value}; }`;
}

/** All numbers of one precision as a texture; null when there are none. */
export function texelTexture(name: string, store: TexelStore): TexelTexture | null {
  if (store.texels === 0) return null;
  const width = 2 ** Math.min(Math.ceil(Math.log2(Math.sqrt(store.texels))), Math.log2(TEXTURE_SIDE));
  const height = Math.ceil(store.texels / width);
  const numbers = store.concat(width * height) as Float32Array<ArrayBuffer>;
  if (!store.half) return { name, width, height, format: "rgba32float", data: numbers };
  return { name, width, height, format: "rgba16float", data: Uint16Array.from(numbers, toHalf) };
}
