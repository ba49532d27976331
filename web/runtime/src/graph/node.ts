/** A graph that has been checked. */

import type { Op, Use } from "./op.ts";

/** One operation, checked. */
export interface GraphNode {
  readonly id: string;
  readonly op: Op;
  readonly opName: string;
  readonly inputs: readonly string[];
  readonly perFrame: boolean;
  readonly use: Use;
  readonly width: number;
}

/** A list of nodes in evaluation order over named inputs. */
export interface Graph {
  /** Name to width, in the order of the file: the order of the printed function's parameters. */
  readonly inputs: ReadonlyMap<string, number>;
  readonly nodes: readonly GraphNode[];
  /** Name of the output to the name of the value. */
  readonly outputs: ReadonlyMap<string, string>;
  /** Width of every input and node. */
  readonly widths: ReadonlyMap<string, number>;
  /** Multiply-adds per pixel, once a frame, and table entries read per pixel. */
  readonly macs: number;
  readonly macsPerFrame: number;
  readonly fetches: number;
  /** Work per pixel as the budget counts it. */
  readonly work: number;
}
