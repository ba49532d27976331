/** Prints a shading graph in the language of an engine. Everything is evaluated per pixel. */

import { BUDGET } from "./budget.ts";
import type { Dialect } from "./dialects.ts";
import { type TexelTexture, texelTexture } from "./glsl.ts";
import type { Graph } from "./node.ts";
import type { StoredBuffer } from "./op.ts";
import type { Value } from "./printer.ts";
import { narrow, printProgram } from "./program.ts";

export interface DialectProgram {
  /** Declarations and functions. */
  readonly code: string;
  /** The function's own type, name and parameters. */
  readonly signature: string;
  /** Inputs in the order of the function's parameters; those wider than 4 are arrays of vec4. */
  readonly parameters: readonly { readonly name: string; readonly width: number }[];
  /** Textures of numbers, then pictures: the order of the parameters behind the inputs, where textures are parameters. */
  readonly textures: readonly TexelTexture[];
  readonly pictures: ReadonlyMap<string, StoredBuffer>;
}

export interface DialectOptions {
  /** Name of the function and prefix of everything else. */
  readonly name: string;
  /** `inline`: literals. `texture`: loops over a texture. Tables and experts are always textures. */
  readonly weights: "inline" | "texture";
}

/** Print a graph as one function of a language. */
export function printDialect(graph: Graph, dialect: Dialect, { name, weights }: DialectOptions): DialectProgram {
  const { printer, parameters, outputs } = printProgram(graph, dialect, {
    prefix: name,
    weights: weights === "inline" ? "inline" : "table",
    halfTexels: true,
    limit: BUDGET.text,
  });
  const textures = [texelTexture(`${name}_full_texels`, printer.full), texelTexture(`${name}_half_texels`, printer.half)].filter((t) => t !== null);
  const pictures = new Map([...printer.pictures].map(([buffer, sampler]) => [sampler, buffer]));
  const bound = [
    ...textures.map((texture) => dialect.texels(texture.name)),
    ...[...pictures].flatMap(([picture, { picture: stored }]) => dialect.picture(picture, stored!.mips > 0)),
  ];
  const inputs = parameters.map(({ width }, i) =>
    width > 4 ? dialect.arrayParameter(`i${i}`, Math.ceil(width / 4)) : `${vector(dialect, width)} i${i}`,
  );
  const { type, struct, result } = resultOf(dialect, name, outputs);
  const signature = `${type} ${name}(${[...inputs, ...(dialect.passesTextures ? bound : [])].join(", ")})`;
  const readers = textures.map(({ name: texture, width }) => [texture.replace(/_texels$/, ""), texture, width] as const);
  const code = [
    ...(dialect.passesTextures ? [] : bound.map((declaration) => `${declaration};`)),
    ...readers.map(([read, texture, width]) => dialect.readTexel(read, texture, width)),
    ...struct,
    ...printer.helpers.values(),
    `${dialect.linkage}${signature} {`,
    ...printer.lines,
    ...result.map((line) => `  ${line}`),
    "}",
    ...(dialect.passesTextures ? readers.map(([read]) => `#undef ${read}`) : []),
  ].join("\n");
  return { code, signature, parameters: parameters.map(({ name, width }) => ({ name, width })), textures, pictures };
}

const vector = (dialect: Dialect, width: number) => dialect.type(width === 1 ? "float" : (`vec${width}` as "vec2" | "vec3" | "vec4"));

/** The type of the result, its declaration when it is a struct, and the statements that return it. */
function resultOf(
  dialect: Dialect,
  name: string,
  outputs: readonly { readonly name: string; readonly value: Value }[],
): { type: string; struct: string[]; result: string[] } {
  const [first] = outputs;
  if (outputs.length === 1 && first!.value.width <= 4)
    return { type: vector(dialect, first!.value.width), struct: [], result: [`return ${narrow(first!.value)};`] };
  const type = `${name}_result`;
  const members = outputs.map(({ name: output, value }, i) => `  ${dialect.type("vec4")} o${i}[${value.blocks}]; // ${output}\n`);
  const sets = outputs.flatMap(({ value }, i) => Array.from({ length: value.blocks }, (_, b) => `result.o${i}[${b}] = ${value.block(b)};`));
  return { type, struct: [`struct ${type} {\n${members.join("")}};`], result: [`${type} result;`, ...sets, "return result;"] };
}
