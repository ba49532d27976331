/**
 * What a graph may ask of one pixel, one frame and one shader (format/FORMAT.md, *Budget*). It is counted before anything
 * is printed or evaluated, so that a small file cannot ask for a large amount of work.
 */

import { fail } from "../checks.ts";
import type { GraphNode } from "./node.ts";

/** Limits of the work of a file; those of `format/budget.json` unless raised. */
export interface Budget {
  /** Work per pixel of all fields of a file, each for one light: multiply-adds, components of values, numbers read from tables. */
  readonly work: number;
  /** Work per frame of the `per_frame` nodes, which run on the CPU. */
  readonly workPerFrame: number;
  /** Components of values that are needed at the same time in a pixel. */
  readonly live: number;
  /** Characters of a shader's text. */
  readonly text: number;
}

/**
 * The default. 100,000 is four times the largest network that a bake writes; 2,048 numbers are the 8,192 bytes that every
 * WebGPU implementation has for the variables of a function (WGSL, *Limits*).
 */
export const BUDGET: Budget = { work: 100_000, workPerFrame: 1_000_000, live: 2_048, text: 1_000_000 };

/** The default budget with some limits raised or lowered. */
export function budgetOf(change: Partial<Budget> = {}): Budget {
  return { ...BUDGET, ...change };
}

/** Work of one evaluation of a node: multiply-adds, the widest value that it touches, numbers that it reads from tables. */
export function workOf({ op, use, width }: Pick<GraphNode, "op" | "use" | "width">): number {
  const [table] = Object.values(use.buffer);
  const fetched = (op.fetches?.(use) ?? 0) * (table?.shape.at(-1) ?? 0);
  return (op.macs?.(use) ?? 0) + fetched + Math.max(width, ...use.widths);
}

/** Adds up work and throws a `FormatError` as soon as it is more than the budget. */
export class WorkCounter {
  readonly budget: Budget;
  perPixel = 0;
  perFrame = 0;

  constructor(budget: Budget) {
    this.budget = budget;
  }

  /** Count a node. */
  add(node: GraphNode, where: string): void {
    if (node.perFrame) this.perFrame += workOf(node);
    else this.perPixel += workOf(node);
    const { work, workPerFrame } = this.budget;
    if (this.perPixel > work) fail(where, overBudget(work, "operations per pixel", "work"));
    if (this.perFrame > workPerFrame) fail(where, overBudget(workPerFrame, "operations per frame", "workPerFrame"));
  }
}

/** What was expected, and the cure. */
export function overBudget(limit: number, what: string, option: string): string {
  return `at most ${limit} ${what} up to here; use a smaller field, or raise the budget's \`${option}\` if you trust the file`;
}

/**
 * Throws a `FormatError` when more components than `budget.live` are needed at the same time. What is evaluated once a frame
 * does not count: shaders read it from a uniform or a texture.
 */
export function checkLive(
  all: readonly GraphNode[],
  inputs: ReadonlyMap<string, number>,
  outputs: Iterable<string>,
  budget: Budget,
  where: string,
): void {
  const nodes = all.filter((node) => !node.perFrame);
  const last = new Map<string, number>();
  nodes.forEach((node, i) => {
    for (const input of node.inputs) last.set(input, i);
  });
  for (const output of outputs) last.set(output, nodes.length);
  const size = (width: number) => 4 * Math.ceil(width / 4);
  const ending = nodes.map((): number => 0);
  let live = 0;
  const begin = (name: string, width: number) => {
    const end = last.get(name);
    if (end === undefined) return;
    live += size(width);
    if (end < nodes.length) ending[end]! += size(width);
  };
  for (const [name, width] of inputs) begin(name, width);
  nodes.forEach((node, i) => {
    begin(node.id, node.width);
    if (live > budget.live) fail(`${where} ('${node.id}')`, overBudget(budget.live, "numbers needed at a time", "live"));
    live -= ending[i]!;
  });
}
