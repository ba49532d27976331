/** Rows of a stored table as texels, and how shaders read them. */

import { valuesOf } from "../buffers.ts";
import type { Language } from "../language.ts";
import type { StoredBuffer, Use } from "../op.ts";
import type { Printer, Table, Value } from "../printer.ts";

/** Numbers of one entry in a table: 1 or 2 share a texel, wider entries start a texel of their own. */
const stride = (channels: number) => (channels <= 2 ? channels : 4 * Math.ceil(channels / 4));

/**
 * Rows of at most so many blocks are read by a statement for each: Mesa's llvmpipe compiles arrays that loops write ten times as long
 * (eight rows of 216 numbers, a probe's neighbours: 20 s), and they are slower to draw. 16 bases of 27 numbers have 108.
 */
const MOST_UNROLLED = 128;

/** The rows of a buffer as texels. */
export function rowTable(printer: Printer, buffer: StoredBuffer): Table {
  const channels = buffer.shape.at(-1)!;
  const step = stride(channels);
  const rows = buffer.data.length / channels;
  const texels = Math.ceil((rows * step) / 4);
  return printer.table([buffer], buffer.type === "float16", texels, () => {
    const values = valuesOf(buffer);
    const out = new Float32Array(4 * texels);
    for (let row = 0; row < rows; row++) {
      for (let c = 0; c < channels; c++) out[row * step + c] = values[row * channels + c]!;
    }
    return out;
  });
}

/** Emit `sum[b] += weight * row[b]` for every block of a row, given the name of an int variable with its number. */
export function accumulateRow(
  printer: Printer,
  language: Language,
  table: Table,
  channels: number,
  row: string,
  weight: string,
  sum: Value,
): void {
  if (channels <= 2) {
    const texel = printer.temporary();
    const index = `${table.first} + (${row} >> ${channels === 1 ? 2 : 1}${language.places})`;
    printer.emit(language.constant("vec4", texel, table.texel(index)));
    const zeros = ["0.0", "0.0"];
    const value =
      channels === 1
        ? printer.vec4(`${texel}[${row} & 3]`, "0.0", ...zeros)
        : language.choose(
            `(${row} & 1) == 0`,
            printer.vec4(`${texel}.xy`, ...zeros),
            printer.vec4(`${texel}.zw`, ...zeros),
          );
    printer.emit(`${sum.block("0")} += ${weight} * ${value};`);
    return;
  }
  printer.loop(sum.blocks, (i) =>
    printer.emit(
      `${sum.block(i)} += ${weight} * ${table.texel(`${table.first} + ${row} * ${sum.blocks} + ${i}`)};`,
    ),
  );
}

/** Emit `out = row` of a table. */
export function printRow(use: Use, printer: Printer, out: Value, row: string): void {
  const table = rowTable(printer, use.buffer.buffer!);
  if (out.width > 2 && out.blocks <= MOST_UNROLLED) {
    for (let i = 0; i < out.blocks; i++) printer.store(out, i, table.texel(`${table.first + i} + ${row} * ${out.blocks}`));
    return;
  }
  printer.zeros(out);
  accumulateRow(printer, printer.language, table, out.width, row, "1.0", out);
}
