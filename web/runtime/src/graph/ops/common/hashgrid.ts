/** Multi-resolution hash grid: Müller et al. 2022; `format/FORMAT.md` gives the exact definition. */

import { valuesOf } from "../../buffers.ts";
import type { Op, Use } from "../../op.ts";
import { Value } from "../../printer.ts";
import { accumulateRow, rowTable } from "../table-rows.ts";

const PRIMES = [1, 2654435761, 805459861] as const;
const MAX_CELLS = 1 << 16;

interface Level {
  readonly cells: number;
  readonly offset: number;
  readonly entries: number;
  readonly dense: boolean;
}

/** Which lattice each level has and where its entries lie. */
function levels(use: Use): Level[] {
  const { levels: count, base, growth, entries_log2 } = use.number as Record<string, number>;
  const out: Level[] = [];
  let offset = 0;
  let size = base!;
  for (let i = 0; i < count!; i++) {
    const cells = Math.floor(Math.min(size, MAX_CELLS) + 1e-6);
    const vertices = (cells + 1) ** 3;
    const dense = vertices <= 2 ** entries_log2!;
    const entries = dense ? vertices : 2 ** entries_log2!;
    out.push({ cells, offset, entries, dense });
    offset += entries;
    size *= growth!;
  }
  return out;
}

function entry(level: Level, x: number, y: number, z: number): number {
  if (level.dense) return x + (level.cells + 1) * (y + (level.cells + 1) * z);
  return ((x ^ Math.imul(y, PRIMES[1]) ^ Math.imul(z, PRIMES[2])) & (level.entries - 1)) >>> 0;
}

export const hashgrid: Op = {
  arity: [1, 1],
  parameters: {
    buffer: { kind: "buffer", ranks: [2] },
    levels: { kind: "integer", low: 1, high: 32 },
    base: { kind: "number", low: 1, high: MAX_CELLS },
    growth: { kind: "number", low: 1, high: 16 },
    entries_log2: { kind: "integer", low: 3, high: 24 },
  },
  width(use) {
    use.expect(use.widths[0] === 3, "a point of width 3");
    const [entries, channels] = use.buffer.buffer!.shape as [number, number];
    const last = levels(use).at(-1)!;
    use.expect(entries === last.offset + last.entries, `a buffer of ${last.offset + last.entries} entries`);
    return use.number.levels! * channels;
  },
  fetches: (use) => 8 * use.number.levels!,
  evaluate(use, [p]) {
    const values = valuesOf(use.buffer.buffer!);
    const channels = use.buffer.buffer!.shape[1]!;
    return levels(use).flatMap((level) => {
      const at = [...p!].map((x) => Math.fround(Math.min(Math.max(x, 0), 1) * level.cells));
      const low = at.map((x) => Math.min(Math.floor(x), level.cells - 1));
      const sum = new Array<number>(channels).fill(0);
      for (let corner = 0; corner < 8; corner++) {
        const upper = [0, 1, 2].map((axis) => (corner >> axis) & 1);
        const weight = upper.reduce(
          (w, u, axis) => w * (u ? at[axis]! - low[axis]! : 1 - at[axis]! + low[axis]!),
          1,
        );
        const [x, y, z] = low.map((i, axis) => i + upper[axis]!) as [number, number, number];
        const row = level.offset + entry(level, x, y, z);
        for (let c = 0; c < channels; c++) sum[c]! += weight * values[row * channels + c]!;
      }
      return sum;
    });
  },
  print(use, printer, out, [p], language) {
    const channels = use.buffer.buffer!.shape[1]!;
    const table = rowTable(printer, use.buffer.buffer!);
    const layout = levels(use);
    const [float, int, uint, vec3] = (["float", "int", "uint", "vec3"] as const).map((type) =>
      language.type(type),
    );
    // Cells, first entry, mask of the hash (0: every vertex has an entry of its own).
    const rows = layout.map(
      (l) => `${language.type("ivec4")}(${l.cells}, ${l.offset}, ${l.dense ? 0 : l.entries - 1}, 0)`,
    );
    const sum = new Value(printer.temporary(), channels);
    printer.zeros(out);
    printer.emit(
      "{",
      language.table("ivec4", "layout_", rows),
      language.constant("vec3", "unit", `clamp(${p!.block(0)}.xyz, ${language.splat("vec3", "0.0")}, ${language.splat("vec3", "1.0")})`),
    );
    printer.loop(layout.length, (level) => {
      printer.emit(
        language.constant("ivec4", "level", `layout_[${level}]`),
        language.constant("vec3", "at", `unit * ${float}(level.x)`),
        language.constant("vec3", "low", `min(floor(at), ${language.splat("vec3", `${float}(level.x - 1)`)})`),
      );
      printer.zeros(sum);
      printer.loop(8, (corner) => {
        const bits = [0, 1, 2].map((axis) => `${float}((${corner} >> ${axis}${language.places}) & 1)`).join(", ");
        printer.emit(
          language.constant("vec3", "upper", `${vec3}(${bits})`),
          language.constant("vec3", "share", `${language.mix}(1.0 - (at - low), at - low, upper)`),
          ...["x", "y", "z"].map((axis) =>
            language.constant("int", axis, `${int}(low.${axis} + upper.${axis})`),
          ),
          language.constant("int", "dense", "x + (level.x + 1) * (y + (level.x + 1) * z)"),
          language.constant(
            "int",
            "hashed",
            `${int}(${uint}(x) ^ (${uint}(y) * ${PRIMES[1]}u) ^ (${uint}(z) * ${PRIMES[2]}u)) & level.z`,
          ),
          language.constant("int", "row", `level.y + ${language.choose("level.z == 0", "dense", "hashed")}`),
          language.constant("float", "weight", "share.x * share.y * share.z"),
        );
        accumulateRow(printer, language, table, channels, "row", "weight", sum);
      });
      if (channels % 4 === 0) {
        printer.loop(sum.blocks, (i) =>
          printer.emit(`${out.name}[${level} * ${sum.blocks} + ${i}] = ${sum.block(i)};`),
        );
      } else {
        for (let c = 0; c < channels; c++) {
          const index = `(${level} * ${channels} + ${c})`;
          printer.emit(`${out.name}[${index} >> 2${language.places}][${index} & 3] = ${sum.at(c)};`);
        }
      }
    });
    printer.emit("}");
  },
};
