/** The op rows: a row of a table by its number. */

import { valuesOf } from "../../buffers.ts";
import { MAX_EXACT, MAX_WIDTH, type Op } from "../../op.ts";
import { printRoundedIndex, roundedIndex } from "../rounded-index.ts";
import { printRow } from "../table-rows.ts";

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
