/** Prints a shading graph as WGSL. */

import type { FrameLayout } from "./frame.ts";
import type { Graph } from "./graph.ts";
import { WGSL } from "./language.ts";
import { narrow, printProgram } from "./program.ts";

export interface WgslProgram {
  /** Bindings, helper functions and the function. */
  readonly code: string;
  /** Type of the result: `f32`, `vec2f`, `vec3f`, `vec4f`, or a struct with `array<vec4f, blocks>` per output. */
  readonly type: string;
  /** Inputs in the order of the function's parameters; those wider than 4 are arrays of vec4f. */
  readonly parameters: readonly { readonly name: string; readonly width: number }[];
  /** Contents of the read-only storage buffer, or null when everything is in the text. */
  readonly weights: { readonly binding: number; readonly data: Float32Array<ArrayBuffer> } | null;
  /** The uniform buffer of 4 · blocks floats to fill with `evaluateFrame`, or null. */
  readonly frame: (FrameLayout & { readonly binding: number }) | null;
}

export interface WgslOptions {
  /** Name of the function and prefix of everything else. */
  readonly name: string;
  /** `inline`: literals. `storage`: loops over a storage buffer. Tables and experts are always in the buffer. */
  readonly weights: "inline" | "storage";
  /** Bind group, and the first of two binding numbers: weights, frame. Both 0 unless given. */
  readonly group?: number;
  readonly binding?: number;
}

/** Print a graph as `fn name(inputs…) -> TYPE`. */
export function printWgsl(graph: Graph, { name, weights, group = 0, binding = 0 }: WgslOptions): WgslProgram {
  const { printer, frame, parameters, outputs } = printProgram(
    graph,
    WGSL,
    name,
    weights === "inline" ? "inline" : "table",
    false,
  );
  const single = outputs.length === 1 && outputs[0]!.value.width <= 4;
  const type = single ? vector(outputs[0]!.value.width) : `${name}_result`;
  const struct = `struct ${type} {\n${outputs
    .map(({ name: output, value }, i) => `  o${i}: array<vec4f, ${value.blocks}>, // ${output}\n`)
    .join("")}}`;
  const result: string[] = [];
  if (single) result.push(`return ${narrow(outputs[0]!.value)};`);
  else {
    result.push(`var result: ${type};`);
    for (const [i, { value }] of outputs.entries()) {
      for (let b = 0; b < value.blocks; b++) result.push(`result.o${i}[${b}] = ${value.block(b)};`);
    }
    result.push("return result;");
  }
  const store = printer.full;
  const code = [
    ...(store.texels
      ? [
          `@group(${group}) @binding(${binding}) var<storage, read> ${name}_texels: array<vec4f>;`,
          `fn ${name}_full(i: i32) -> vec4f { return ${name}_texels[i]; }`,
        ]
      : []),
    ...(frame.blocks
      ? [
          `@group(${group}) @binding(${binding + 1}) var<uniform> ${name}_frame: array<vec4f, ${frame.blocks}>;`,
          `fn ${name}_frame_at(i: i32) -> vec4f { return ${name}_frame[i]; }`,
        ]
      : []),
    ...(single ? [] : [struct]),
    ...printer.helpers.values(),
    `fn ${name}(${parameters
      .map((p, i) =>
        p.width > 4 ? `i${i}_: array<vec4f, ${Math.ceil(p.width / 4)}>` : `i${i}: ${vector(p.width)}`,
      )
      .join(", ")}) -> ${type} {`,
    // A parameter cannot be indexed by a variable: copy arrays first.
    ...parameters.flatMap((p, i) => (p.width > 4 ? [`  var i${i} = i${i}_;`] : [])),
    ...printer.lines,
    ...result.map((line) => `  ${line}`),
    "}",
  ].join("\n");
  return {
    code,
    type,
    parameters: parameters.map(({ name, width }) => ({ name, width })),
    weights: store.texels ? { binding, data: store.concat() as Float32Array<ArrayBuffer> } : null,
    frame: frame.blocks ? { ...frame, binding: binding + 1 } : null,
  };
}

function vector(width: number): string {
  return width === 1 ? "f32" : `vec${width}f`;
}
