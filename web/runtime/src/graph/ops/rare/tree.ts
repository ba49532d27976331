/** A binary tree that finds the leaf of a point: the regions of a field that has one small network in each. */

import { valuesOf } from "../../buffers.ts";
import { MAX_EXACT, type Op, type Use } from "../../op.ts";
import { rowTable } from "../table-rows.ts";

const MAX_DEPTH = 64;
/** Numbers of a row: axis, threshold, below, above. */
const ROW = 4;

/** Throws unless every walk stays inside the buffer and ends in a leaf, so that shaders need no guard. */
function check(use: Use): void {
  const { shape, type } = use.buffer.nodes!;
  const [rows, columns] = shape as [number, number];
  use.expect(type === "float32", "nodes of type float32");
  use.expect(columns === ROW, "rows of axis, threshold, below, above");
  use.expect(rows <= MAX_EXACT, `at most ${MAX_EXACT} rows`);
  const nodes = valuesOf(use.buffer.nodes!);
  const levels = new Uint8Array(rows);
  // Children come after their parents: backwards, their levels are known.
  for (let row = rows - 1; row >= 0; row--) {
    const axis = nodes[ROW * row]!;
    use.expect(
      Number.isInteger(axis) && axis >= 0 && axis < use.widths[0]!,
      `an axis from 0 to ${use.widths[0]! - 1} in row ${row}`,
    );
    let below = 0;
    for (const child of nodes.subarray(ROW * row + 2, ROW * row + ROW)) {
      use.expect(
        Number.isInteger(child) && Math.abs(child) <= MAX_EXACT && (child < 0 || (child > row && child < rows)),
        `children of row ${row} that are leaves or rows after it, below ${rows}`,
      );
      if (child >= 0) below = Math.max(below, levels[child]!);
    }
    // Saturates: deeper than any depth is deep enough to know.
    levels[row] = Math.min(below + 1, MAX_DEPTH + 1);
  }
  use.expect(levels[0]! <= use.number.depth!, `a tree of at most ${use.number.depth} levels, its depth`);
}

export const tree: Op = {
  arity: [1, 1],
  parameters: {
    nodes: { kind: "buffer", ranks: [2] },
    depth: { kind: "integer", low: 1, high: MAX_DEPTH },
  },
  width(use) {
    check(use);
    return 1;
  },
  fetches: (use) => use.number.depth!,
  evaluate(use, [a]) {
    const nodes = valuesOf(use.buffer.nodes!);
    let child = 0;
    while (child >= 0) {
      const [axis, threshold, below, above] = nodes.subarray(ROW * child, ROW * child + ROW);
      child = a![axis!]! < threshold! ? below! : above!;
    }
    return [-1 - child];
  },
  print(use, printer, out, [a], language) {
    const table = rowTable(printer, use.buffer.nodes!);
    const depth = use.number.depth!;
    const point = printer.indexable(printer.local(a!));
    const child = printer.temporary();
    const component = point.blocks === 1 ? `${point.block(0)}[axis]` : `${point.block(`(axis >> 2${language.places})`)}[axis & 3]`;
    printer.emit(language.variable("int", child, "0"), "{");
    printer.loop(depth, () => {
      printer.emit(
        language.constant("vec4", "node", table.texel(`${table.first} + ${child}`)),
        language.constant("int", "axis", `${language.type("int")}(node.x)`),
        `${child} = ${language.type("int")}(${language.choose(`${component} < node.y`, "node.z", "node.w")});`,
        ...(depth > 1 ? [`if (${child} < 0) { break; }`] : []),
      );
    });
    printer.emit("}");
    printer.perComponent(out, [`${language.type("float")}(-1 - ${child})`]);
  },
};
