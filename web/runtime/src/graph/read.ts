/** Reads graphs that may name any op. */

import type { Budget } from "./budget.ts";
import { readGraphOf } from "./graph.ts";
import type { Graph } from "./node.ts";
import { OPS } from "./ops/index.ts";
import type { StoredBuffer } from "./stored.ts";

/**
 * Check a graph and its buffers (stored numbers by name), and that it stays within a budget; throws a `FormatError` that
 * names what is wrong.
 */
export function readGraph(json: unknown, stored: ReadonlyMap<string, StoredBuffer>, budget?: Budget): Graph {
  return readGraphOf(OPS, json, stored, budget);
}
