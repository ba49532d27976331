/** What a graph computes once a frame: evaluated on the CPU, handed to the shader as vec4 blocks. */

import { evaluateNodes } from "./evaluate.ts";
import type { Graph } from "./node.ts";
import { frameValues } from "./needed.ts";

/** Blocks of each `per_frame` value that pixels read. */
export interface FrameLayout {
  /** Name of the value to its first block. */
  readonly first: ReadonlyMap<string, number>;
  /** Number of vec4; 0 when the graph has no per-frame part. */
  readonly blocks: number;
}

/** Where the per-frame values of a graph lie. */
export function frameLayout(graph: Graph): FrameLayout {
  const first = new Map<string, number>();
  let blocks = 0;
  for (const node of frameValues(graph)) {
    first.set(node.id, blocks);
    blocks += Math.ceil(node.width / 4);
  }
  return { first, blocks };
}

/** The per-frame values for the given frame inputs (`light`, `lamps`, `pose`), as blocks: 4 · blocks numbers. Without `lamps`, they are as baked; without `pose`, nodes are at their first value. */
export function evaluateFrame(
  graph: Graph,
  inputs: Readonly<Record<string, ArrayLike<number>>>,
  out = new Float32Array(4 * frameLayout(graph).blocks),
): Float32Array {
  const given = { lamps: Array(graph.inputs.get("lamps") ?? 0).fill(1), pose: Array(graph.inputs.get("pose") ?? 0).fill(0), ...inputs };
  const values = evaluateNodes(graph, given, true);
  for (const [name, first] of frameLayout(graph).first) out.set(values.get(name)!, 4 * first);
  return out;
}
