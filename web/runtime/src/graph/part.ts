/** Parts of a graph, and what they cost. */

import { workOf } from "./budget.ts";
import type { Graph, GraphNode } from "./node.ts";

/** The part of a graph that these outputs need; outputs that it lacks are left out. */
export function only(graph: Graph, ...names: readonly string[]): Graph {
  const outputs = new Map([...graph.outputs].filter(([key]) => names.includes(key)));
  const needed = new Set(outputs.values());
  for (const node of [...graph.nodes].reverse()) {
    if (needed.has(node.id)) for (const input of node.inputs) needed.add(input);
  }
  const nodes = graph.nodes.filter((node) => needed.has(node.id));
  const inputs = new Map([...graph.inputs].filter(([key]) => needed.has(key)));
  return { inputs, nodes, outputs, widths: graph.widths, ...costs(nodes) };
}

/** What nodes ask for per pixel and per frame. */
export function costs(nodes: readonly GraphNode[]): Pick<Graph, "macs" | "macsPerFrame" | "fetches" | "work"> {
  const total = (cost: "macs" | "fetches", perFrame: boolean) =>
    nodes.filter((n) => n.perFrame === perFrame).reduce((sum, n) => sum + (n.op[cost]?.(n.use) ?? 0), 0);
  const work = nodes.filter((n) => !n.perFrame).reduce((sum, n) => sum + workOf(n), 0);
  return { macs: total("macs", false), macsPerFrame: total("macs", true), fetches: total("fetches", false), work };
}
