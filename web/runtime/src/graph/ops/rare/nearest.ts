/** The op nearest: the entry of a table over the unit cube whose cell holds the point. */

import { valuesOf } from "../../buffers.ts";
import { literal } from "../../language.ts";
import type { Op } from "../../op.ts";
import { sizesOf, tableOp } from "../interpolated-table.ts";
import { printRow } from "../table-rows.ts";

export const nearest: Op = {
  ...tableOp(3),
  fetches: () => 1,
  evaluate(use, [p], width) {
    let row = 0;
    for (const [axis, size] of [...sizesOf(use).entries()].reverse()) {
      const at = Math.fround(Math.min(Math.max(p![axis]!, 0), 1) * size);
      row = row * size + Math.min(Math.floor(at), size - 1);
    }
    return valuesOf(use.buffer.buffer!).subarray(row * width, (row + 1) * width);
  },
  print(use, printer, out, [p], language) {
    const sizes = sizesOf(use);
    const [width, height] = sizes as [number, number];
    const vec3 = (numbers: readonly number[]) => `${language.type("vec3")}(${numbers.map(literal).join(", ")})`;
    const int = language.type("int");
    const [cell, row] = [printer.temporary(), printer.temporary()];
    const unit = `clamp(${p!.block(0)}.xyz, ${vec3([0, 0, 0])}, ${vec3([1, 1, 1])})`;
    const last = vec3(sizes.map((size) => size - 1));
    printer.emit(
      language.constant("vec3", cell, `min(floor(${unit} * ${vec3(sizes)}), ${last})`),
      language.constant(
        "int",
        row,
        `(${int}(${cell}.z) * ${height} + ${int}(${cell}.y)) * ${width} + ${int}(${cell}.x)`,
      ),
    );
    printRow(use, printer, out, row);
  },
};
