/** Prints the body of a graph's function: parameters, statements, result; shared by GLSL and WGSL. */

import { type FrameLayout, frameLayout } from "./frame.ts";
import { FRAME_ONLY } from "./graph.ts";
import { neededNodes } from "./needed.ts";
import type { Graph } from "./node.ts";
import type { Language } from "./language.ts";
import { Printer, type PrinterOptions, Value } from "./printer.ts";

/** The text of a graph, before a language puts its declarations around it. */
export interface Program {
  readonly printer: Printer;
  readonly frame: FrameLayout;
  /** Parameters of the function as [type or array size, name]; in the order of the graph's inputs. */
  readonly parameters: readonly { readonly name: string; readonly width: number }[];
  /** The outputs by name, as values that the last statements may read. */
  readonly outputs: readonly { readonly name: string; readonly value: Value }[];
}

/** Print all statements of a graph. `frameAt` is the name of the function that reads a block of the per-frame values. */
export function printProgram(graph: Graph, language: Language, options: PrinterOptions): Program {
  const { prefix } = options;
  const printer = new Printer(language, options);
  const frame = frameLayout(graph);
  const values = new Map<string, Value>();
  // What per-frame nodes alone read is no parameter.
  const needed = neededNodes(graph);
  const read = new Set([...needed.flatMap((node) => node.inputs), ...graph.outputs.values()]);
  const given = [...graph.inputs].filter(([name]) => !FRAME_ONLY.includes(name) || read.has(name));
  const parameters = given.map(([name, width], i) => {
    const value = new Value(`i${i}`, width);
    values.set(name, value);
    return { name, width, value };
  });
  for (const { name, width, value } of parameters) {
    printer.emit(`// ${name}`);
    readParameter(printer, value, width);
  }
  for (const [name, first] of frame.first) {
    const value = new Value(`${prefix}_frame_at`, graph.widths.get(name)!);
    value.storage = "call";
    value.first = first;
    values.set(name, value);
  }
  for (const [i, node] of needed.entries()) {
    const out = new Value(`v${i}`, node.width);
    printer.emit(`// ${node.id}: ${node.opName}`);
    const inputs = node.inputs.map((input) => values.get(input)!);
    node.op.print(node.use, printer, out, inputs, language);
    values.set(node.id, out);
  }
  const outputs = [...graph.outputs].map(([name, id]) => ({ name, value: values.get(id)! }));
  return { printer, frame, parameters, outputs };
}

/** Bring a parameter into blocks: wide ones arrive as arrays of blocks. */
function readParameter(printer: Printer, value: Value, width: number): void {
  if (width > 4) {
    value.storage = "array";
    value.declared = true;
    return;
  }
  const zeros = Array(4 - width).fill("0.0");
  printer.store(value, 0, width === 4 ? value.name : printer.vec4(value.name, ...zeros));
}

/** The result of the function as `width` components: a scalar or a vector of up to four. */
export function narrow(value: Value): string {
  if (value.width === 4) return value.block(0);
  return `${value.block(0)}.${"xyz".slice(0, value.width)}`;
}
