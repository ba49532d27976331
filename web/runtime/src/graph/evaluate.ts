/** Evaluates a graph on the CPU, one point at a time: for what depends on the frame only, and as a check of the printers. */

import type { Graph } from "./node.ts";

/** All values of a graph (or of its `per_frame` nodes only) at one point: inputs and results by name. */
export function evaluateNodes(
  graph: Graph,
  inputs: Readonly<Record<string, ArrayLike<number>>>,
  framesOnly = false,
): Map<string, Float32Array> {
  const values = new Map<string, Float32Array>();
  for (const [name, width] of graph.inputs) {
    const given = inputs[name];
    if (!given && framesOnly) continue;
    if (given?.length !== width)
      throw new TypeError(`graph input '${name}': expected ${width} numbers, found ${given?.length}`);
    values.set(name, Float32Array.from(given));
  }
  for (const node of graph.nodes) {
    if (framesOnly && !node.perFrame) continue;
    const value = node.op.evaluate(
      node.use,
      node.inputs.map((input) => values.get(input)!),
      node.width,
    );
    values.set(node.id, Float32Array.from(value));
  }
  return values;
}

/** The outputs of a graph at one point. */
export function evaluate(
  graph: Graph,
  inputs: Readonly<Record<string, ArrayLike<number>>>,
): Record<string, Float32Array> {
  const values = evaluateNodes(graph, inputs);
  return Object.fromEntries([...graph.outputs].map(([name, value]) => [name, values.get(value)!]));
}
