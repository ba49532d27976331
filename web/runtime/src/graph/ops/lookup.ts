/** Tables that are read without interpolation: rows (by number) and nearest (by place). */

import { valuesOf } from "../buffers.ts";
import { literal } from "../language.ts";
import { MAX_EXACT, MAX_WIDTH, type Op } from "../op.ts";
import type { Printer, Value } from "../printer.ts";
import { sizesOf, tableOp } from "./fetch.ts";
import { printRoundedIndex, roundedIndex } from "./rounded-index.ts";
import { accumulateRow, rowTable } from "./table-rows.ts";

/** Emit `out = row` of a table. */
function printRow(use: Parameters<Op["print"]>[0], printer: Printer, out: Value, row: string): void {
  const table = rowTable(printer, use.buffer.buffer!);
  printer.zeros(out);
  accumulateRow(printer, printer.language, table, out.width, row, "1.0", out);
}

export const rows: Op = {
  arity: [1, 1],
  parameters: { buffer: { kind: "buffer", ranks: [2] } },
  width(use) {
    const [count, channels] = use.buffer.buffer!.shape as [number, number];
    use.expect(use.widths[0] === 1, "an index of width 1");
    use.expect(
      count <= MAX_EXACT && channels <= MAX_WIDTH,
      `at most ${MAX_EXACT} rows of at most ${MAX_WIDTH}`,
    );
    return channels;
  },
  fetches: () => 1,
  evaluate(use, [index], width) {
    const row = roundedIndex(index![0]!, use.buffer.buffer!.shape[0]!);
    return valuesOf(use.buffer.buffer!).subarray(row * width, (row + 1) * width);
  },
  print(use, printer, out, [index], language) {
    const row = printer.temporary();
    printer.emit(
      language.constant("int", row, printRoundedIndex(index!, use.buffer.buffer!.shape[0]!, language)),
    );
    printRow(use, printer, out, row);
  },
};

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
