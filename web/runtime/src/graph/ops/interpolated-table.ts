/** Interpolated tables: texture (bilinear) and grid (trilinear). By hand, because filtering in hardware has few bits. */

import { valuesOf } from "../buffers.ts";
import { type Language, literal } from "../language.ts";
import { MAX_WIDTH, type Op, type StoredBuffer, type Use } from "../op.ts";
import type { Printer, Value } from "../printer.ts";
import { accumulateRow, rowTable } from "./table-rows.ts";

const MAX_SIDE = 4096;
const clamp = (x: number, low: number, high: number) => Math.min(Math.max(x, low), high);

/** Sizes in the order x, y, z of a table [.., H, W, C]. */
export const sizesOf = (use: Use) => use.buffer.buffer!.shape.slice(0, -1).reverse();

function evaluate(use: Use, [p]: readonly Float32Array[], width: number): Float32Array {
  const values = valuesOf(use.buffer.buffer!);
  const sizes = sizesOf(use);
  const at = sizes.map((size, axis) => clamp(clamp(p![axis]!, 0, 1) * size - 0.5, 0, size - 1));
  const low = at.map(Math.floor);
  const out = new Float32Array(width);
  for (let corner = 0; corner < 1 << sizes.length; corner++) {
    let [row, weight, step] = [0, 1, 1];
    for (const [axis, size] of sizes.entries()) {
      const upper = (corner >> axis) & 1;
      const fraction = at[axis]! - low[axis]!;
      row += Math.min(low[axis]! + upper, size - 1) * step;
      weight *= upper ? fraction : 1 - fraction;
      step *= size;
    }
    for (let c = 0; c < width; c++) out[c]! += weight * values[row * width + c]!;
  }
  return out;
}

/**
 * Sample a picture in hardware, at the level that the pixel's footprint asks for, but no smaller one than may be read:
 * beyond it, texels mix places that do not lie together.
 */
function printPicture(buffer: StoredBuffer, printer: Printer, out: Value, p: Value, language: Language): void {
  const name = printer.picture(buffer);
  const [height, width] = buffer.shape as [number, number];
  const [at, footprint] = [printer.temporary(), printer.temporary()];
  const vec2 = language.type("vec2");
  const unit = `clamp(${p.block(0)}.xy, ${vec2}(0.0, 0.0), ${vec2}(1.0, 1.0))`;
  printer.emit(language.constant("vec2", at, unit));
  let level = "0.0";
  if (language.slope && buffer.picture!.mips > 0) {
    printer.emit(language.constant("vec2", footprint, language.slope(at, `${vec2}(${width}.0, ${height}.0)`)));
    const squared = `max(max(${footprint}.x, ${footprint}.y), 1.0)`;
    level = `min(0.5 * log2(${squared}), ${literal(buffer.picture!.mips)})`;
  }
  const offset = buffer.offset ? ` + ${printer.vec4(literal(buffer.offset))}` : "";
  const scale = literal(Math.fround(255 * (typeof buffer.scale === "number" ? buffer.scale : 1)));
  const factor = scale === "1.0" ? "" : ` * ${scale}`;
  const texel = printer.temporary();
  printer.emit(language.constant("vec4", texel, `${language.sample(name, at, level)}${factor}${offset}`));
  printer.store(out, 0, printer.padded(3, texel));
}

function print(use: Use, printer: Printer, out: Value, [p]: readonly Value[], language: Language): void {
  if (use.buffer.buffer!.picture) return printPicture(use.buffer.buffer!, printer, out, p!, language);
  const sizes = sizesOf(use);
  const table = rowTable(printer, use.buffer.buffer!);
  const vec3 = (numbers: readonly number[]) => `${language.type("vec3")}(${numbers.map(literal).join(", ")})`;
  const [width = 1, height = 1, depth = 1] = sizes;
  const point =
    sizes.length === 3 ? `${p!.block(0)}.xyz` : `${language.type("vec3")}(${p!.block(0)}.xy, 0.0)`;
  const int = language.type("int");
  const float = language.type("float");
  printer.zeros(out);
  printer.emit(
    "{",
    language.constant("vec3", "last", vec3([width - 1, height - 1, depth - 1])),
    language.constant("vec3", "unit", `clamp(${point}, ${vec3([0, 0, 0])}, ${vec3([1, 1, 1])})`),
    language.constant(
      "vec3",
      "at",
      `clamp(unit * ${vec3([width, height, depth])} - 0.5, ${vec3([0, 0, 0])}, last)`,
    ),
    language.constant("vec3", "low", "floor(at)"),
  );
  printer.loop(1 << sizes.length, (corner) => {
    printer.emit(
      language.constant(
        "vec3",
        "upper",
        `${language.type("vec3")}(${[0, 1, 2].map((axis) => `${float}((${corner} >> ${axis}${language.places}) & 1)`).join(", ")})`,
      ),
      language.constant("vec3", "share", `${language.mix}(1.0 - (at - low), at - low, upper)`),
      language.constant("vec3", "cell", "min(low + upper, last)"),
      language.constant(
        "int",
        "row",
        `(${int}(cell.z) * ${height} + ${int}(cell.y)) * ${width} + ${int}(cell.x)`,
      ),
      language.constant("float", "weight", "share.x * share.y * share.z"),
    );
    accumulateRow(printer, language, table, out.width, "row", "weight", out);
  });
  printer.emit("}");
}

/** Arity, parameters and width rule of a table that is read at a point. */
export function tableOp(dimensions: number): Pick<Op, "arity" | "parameters" | "width"> {
  return {
    arity: [1, 1],
    parameters: { buffer: { kind: "buffer", ranks: [dimensions + 1], picture: dimensions === 2 } },
    width(use) {
      use.expect(use.widths[0] === dimensions, `coordinates of width ${dimensions}`);
      const { shape } = use.buffer.buffer!;
      use.expect(
        Math.max(...shape.slice(0, -1)) <= MAX_SIDE && shape.at(-1)! <= MAX_WIDTH,
        `a table of at most ${MAX_SIDE} a side`,
      );
      return shape.at(-1)!;
    },
  };
}

/** A table that is interpolated between its entries. */
export function interpolatedOp(dimensions: number): Op {
  return {
    ...tableOp(dimensions),
    fetches: () => 1 << dimensions,
    evaluate,
    print,
  };
}
