/** Prints a shading graph as WGSL. */

import { BUDGET } from "./budget.ts";
import type { FrameLayout } from "./frame.ts";
import type { Graph } from "./node.ts";
import { type Language, WGSL } from "./language.ts";
import type { StoredBuffer } from "./op.ts";
import type { Names } from "./printer.ts";
import { narrow, printProgram } from "./program.ts";

export interface WgslProgram {
  /** Bindings, helper functions and the function. */
  readonly code: string;
  /** `code` without the bindings, for those who declare them under the same names. */
  readonly body: string;
  /** Type of the result: `f32`, `vec2f`, `vec3f`, `vec4f`, or a struct with `array<vec4f, blocks>` per output. */
  readonly type: string;
  /** Inputs in the order of the function's parameters; those wider than 4 are arrays of vec4f. */
  readonly parameters: readonly { readonly name: string; readonly width: number }[];
  /** The read-only storage buffer, or the texture of four numbers a texel; null when everything is in the text. */
  readonly weights: WgslWeights | null;
  /** What to fill with `evaluateFrame`: a uniform buffer of 4 · blocks floats, or a texture with a row a light; or null. */
  readonly frame: (FrameLayout & { readonly name: string; readonly binding: number; readonly slot: string | null }) | null;
  /** Pictures to be sampled; the sampler of each is called `${name}_sampler` and has the binding after it. */
  readonly pictures: readonly { readonly name: string; readonly binding: number; readonly buffer: StoredBuffer }[];
}

export interface WgslWeights {
  readonly name: string;
  readonly binding: number;
  readonly data: Float32Array<ArrayBuffer>;
  /** Texels along x and y of a texture; a storage buffer is one row. */
  readonly size: readonly [number, number];
}

export interface WgslOptions {
  /** Name of the function and prefix of everything else. */
  readonly name: string;
  /** `inline`: literals. `storage`: loops over a storage buffer. Tables and experts are always in the buffer. */
  readonly weights: "inline" | "storage";
  /** Bind group, and the first of the binding numbers: weights, frame, pictures. Both 0 unless given. */
  readonly group?: number;
  readonly binding?: number;
  /** Tables and per-frame values as textures of 32-bit floats in place of buffers. */
  readonly textures?: boolean;
  /** How many sets of per-frame values there are, one a light, if they are in a texture; 1 unless given. */
  readonly lights?: number;
  /** Whether the text is for fragments, which know how far a picture is minified; else pictures are read at level 0. */
  readonly fragment?: boolean;
  /** Most characters of the text; those of the default budget unless given. */
  readonly maxText?: number;
  /** Names of bindings in the text where the host gives them others than the program's own; a sampler has `_sampler` behind it. */
  readonly names?: Names;
}

/** Width of a texture of numbers. */
const TEXTURE_WIDTH = 1024;

const FRAGMENT: Language = {
  ...WGSL,
  slope: (at, size) => {
    const [x, y] = [`dpdx(${at}) * ${size}`, `dpdy(${at}) * ${size}`];
    return `vec2f(dot(${x}, ${x}), dot(${y}, ${y}))`;
  },
};

/** Print a graph as `fn name(inputs…) -> TYPE`. */
export function printWgsl(graph: Graph, options: WgslOptions): WgslProgram {
  const { name, group = 0, binding = 0, textures = false, lights = 1 } = options;
  const language = options.fragment ? FRAGMENT : WGSL;
  const placement = options.weights === "inline" ? "inline" : "table";
  const { printer, frame, parameters, outputs } = printProgram(graph, language, {
    prefix: name,
    weights: placement,
    limit: options.maxText ?? BUDGET.text,
    ...(options.names ? { names: options.names } : {}),
  });
  const bound = (own: string) => printer.bound(own);
  const bind = (at: number, text: string) => `@group(${group}) @binding(${at}) var${text};`;
  const weights = printer.full.texels ? weightsOf(`${name}_texels`, binding, printer.full.concat(), textures) : null;
  const slot = textures && lights > 1 ? `${name}_slot` : null;
  const frameAt = frame.blocks ? { ...frame, name: `${name}_frame`, binding: binding + 1, slot } : null;
  const pictures = [...printer.pictures].map(([buffer, picture], i) => ({
    name: picture,
    binding: binding + 2 + 2 * i,
    buffer,
  }));
  const declarations = [
    ...(weights ? [bind(binding, `${textures ? "" : "<storage, read>"} ${bound(weights.name)}: ${textures ? "texture_2d<f32>" : "array<vec4f>"}`)] : []),
    ...(frameAt ? [bind(frameAt.binding, `${textures ? "" : "<uniform>"} ${bound(frameAt.name)}: ${textures ? "texture_2d<f32>" : `array<vec4f, ${frame.blocks}>`}`)] : []),
    ...pictures.flatMap((picture) => [
      bind(picture.binding, ` ${bound(picture.name)}: texture_2d<f32>`),
      bind(picture.binding + 1, ` ${bound(picture.name)}_sampler: sampler`),
    ]),
  ];
  const { type, struct, result } = resultOf(name, outputs);
  const body = [
    ...(weights ? [`fn ${name}_full(i: i32) -> vec4f { return ${textures ? texel(bound(weights.name)) : `${bound(weights.name)}[i]`}; }`] : []),
    ...(slot ? [`var<private> ${slot}: i32 = 0;`] : []),
    ...(frameAt
      ? [`fn ${name}_frame_at(i: i32) -> vec4f { return ${textures ? `textureLoad(${bound(frameAt.name)}, vec2i(i, ${slot ?? 0}), 0)` : `${bound(frameAt.name)}[i]`}; }`]
      : []),
    ...struct,
    ...printer.helpers.values(),
    `fn ${name}(${parameters.map((p, i) => (p.width > 4 ? `i${i}_: array<vec4f, ${Math.ceil(p.width / 4)}>` : `i${i}: ${vector(p.width)}`)).join(", ")}) -> ${type} {`,
    // A parameter cannot be indexed by a variable: copy arrays first.
    ...parameters.flatMap((p, i) => (p.width > 4 ? [`  var i${i} = i${i}_;`] : [])),
    ...printer.lines,
    ...result.map((line) => `  ${line}`),
    "}",
  ].join("\n");
  return {
    code: [...declarations, body].join("\n"),
    body,
    type,
    parameters: parameters.map(({ name, width }) => ({ name, width })),
    weights,
    frame: frameAt,
    pictures,
  };
}

/** The type of the result, its declaration when it is a struct, and the statements that return it. */
function resultOf(
  name: string,
  outputs: ReturnType<typeof printProgram>["outputs"],
): { type: string; struct: string[]; result: string[] } {
  const [first] = outputs;
  if (outputs.length === 1 && first!.value.width <= 4) {
    return { type: vector(first!.value.width), struct: [], result: [`return ${narrow(first!.value)};`] };
  }
  const type = `${name}_result`;
  const members = outputs.map(
    ({ name: output, value }, i) => `  o${i}: array<vec4f, ${value.blocks}>, // ${output}\n`,
  );
  const sets = outputs.flatMap(({ value }, i) =>
    Array.from({ length: value.blocks }, (_, b) => `result.o${i}[${b}] = ${value.block(b)};`),
  );
  return {
    type,
    struct: [`struct ${type} {\n${members.join("")}}`],
    result: [`var result: ${type};`, ...sets, "return result;"],
  };
}

function weightsOf(name: string, binding: number, data: Float32Array, textures: boolean): WgslWeights {
  if (!textures) return { name, binding, data: data as Float32Array<ArrayBuffer>, size: [data.length / 4, 1] };
  const size = [TEXTURE_WIDTH, Math.ceil(data.length / (4 * TEXTURE_WIDTH))] as const;
  const padded = new Float32Array(4 * size[0] * size[1]);
  padded.set(data);
  return { name, binding, data: padded, size };
}

const texel = (texture: string) =>
  `textureLoad(${texture}, vec2i(i & ${TEXTURE_WIDTH - 1}, i >> ${Math.log2(TEXTURE_WIDTH)}u), 0)`;

function vector(width: number): string {
  return width === 1 ? "f32" : `vec${width}f`;
}
