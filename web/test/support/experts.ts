/** A field with experts: a tree over the room, one constant an expert, a gate between two of them at borders. */

import type { FixtureField } from "./glb.ts";

/** Half width of the band in which two experts share, in metres. */
export const BAND = 0.25;

/**
 * A field whose experts are slabs of the room along x, told apart by a tree; near the middle of the room, x = 0, the
 * experts on both sides share. Its radiance is 0.05 times (1 + the number of the expert).
 */
export function expertField(experts = 4): FixtureField {
  const nodes = balanced(0, experts);
  const constants = Array.from({ length: experts }, (_, i) => 0.05 * (i + 1));
  const half = experts / 2;
  return {
    name: "experts",
    role: "indirect",
    variable: 0,
    graph: {
      version: 1,
      inputs: { position: 3, light: 3 },
      buffers: {
        nodes: { shape: [nodes.length, 4], type: "float32", values: nodes.flat() },
        order: { shape: [experts, 1], type: "uint8", scale: 1, values: constants.map((_, i) => i) },
        w: { shape: [experts, 3, 3], type: "float32", values: new Float32Array(9 * experts) },
        b: { shape: [experts, 3], type: "float32", values: constants.flatMap((x) => [x, x, x]) },
        gate: { shape: [2, 3], type: "float32", values: [-0.5 / BAND, 0, 0, 0.5 / BAND, 0, 0] },
        even: { shape: [2], type: "float32", values: [0.5, 0.5] },
      },
      nodes: [
        { id: "leaf", op: "tree", inputs: ["position"], nodes: "nodes", depth: Math.ceil(Math.log2(experts)) },
        { id: "first", op: "rows", inputs: ["leaf"], buffer: "order" },
        // Shares of the left and the right side: 0 and 1 outside of the band.
        { id: "sides", op: "linear", inputs: ["position"], weights: "gate", bias: "even" },
        { id: "shares", op: "clamp", inputs: ["sides"], low: 0, high: 1 },
        { id: "two", op: "top2", inputs: ["shares"] },
        { id: "share", op: "slice", inputs: ["two"], start: 2, width: 1 },
        { id: "other", op: "slice", inputs: ["two"], start: 1, width: 1 },
        // The experts that touch x = 0 are half - 1 and half; the gate's other side is one of them.
        { id: "second", op: "affine", inputs: ["other"], scale: [1], offset: [half - 1] },
        { id: "y0", op: "linear", inputs: ["position", "first"], weights: "w", bias: "b" },
        { id: "y1", op: "linear", inputs: ["position", "second"], weights: "w", bias: "b" },
        { id: "y", op: "blend", inputs: ["share", "y0", "y1"] },
      ],
      outputs: { radiance: "y", segment: "first", overlap: "share", second: "second" },
    },
  };
}

/** Rows of a balanced tree over slabs low … high − 1 of x in [−1, 1], for a width of `count` slabs in all. */
function balanced(low: number, high: number, count = high, first = 0): number[][] {
  const middle = (low + high) >> 1;
  const left = middle - low > 1 ? balanced(low, middle, count, first + 1) : [];
  const right = high - middle > 1 ? balanced(middle, high, count, first + 1 + left.length) : [];
  const below = left.length ? first + 1 : -1 - low;
  const above = right.length ? first + 1 + left.length : -1 - middle;
  return [[0, (2 * middle) / count - 1, below, above], ...left, ...right];
}
