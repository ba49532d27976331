/** Which nodes of a graph a pixel evaluates, and which values it reads that are evaluated once a frame. */

import type { Graph, GraphNode } from "./node.ts";

/** The nodes that the outputs need and that do not belong to the frame, in order. */
export function neededNodes(graph: Graph): GraphNode[] {
  const needed = new Set(graph.outputs.values());
  const out: GraphNode[] = [];
  for (const node of [...graph.nodes].reverse()) {
    if (!needed.has(node.id) || node.perFrame) continue;
    for (const input of node.inputs) needed.add(input);
    out.unshift(node);
  }
  return out;
}

/** The `per_frame` values that pixels read. */
export function frameValues(graph: Graph): GraphNode[] {
  const read = new Set([...neededNodes(graph).flatMap((node) => node.inputs), ...graph.outputs.values()]);
  return graph.nodes.filter((node) => node.perFrame && read.has(node.id));
}
