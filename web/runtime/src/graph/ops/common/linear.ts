/** Matrix-vector products: linear (stored weights, optionally one set per expert), matvec (computed weights). */

import { valuesOf } from "../../buffers.ts";
import { type Language, literal } from "../../language.ts";
import { MAX_WIDTH, type Op, type Use } from "../../op.ts";
import type { Printer, Value } from "../../printer.ts";
import { printRoundedIndex, roundedIndex } from "../rounded-index.ts";

/** Outputs, inputs and experts of a layer. */
function sizes(use: Use): { outputs: number; inputs: number; experts: number } {
  const { shape } = use.buffer.weights!;
  return { outputs: shape.at(-2)!, inputs: shape.at(-1)!, experts: shape.length === 3 ? shape[0]! : 1 };
}

/** Literals of W and b in the text: one 4×4 matrix per pair of blocks. */
function printInline(use: Use, printer: Printer, out: Value, a: Value, language: Language): void {
  const { outputs, inputs } = sizes(use);
  const weights = valuesOf(use.buffer.weights!);
  const bias = valuesOf(use.buffer.bias!);
  const column = (block: number, input: number) =>
    printer.vec4(
      ...[0, 1, 2, 3].map((i) => {
        const row = 4 * block + i;
        return literal(row < outputs && input < inputs ? weights[row * inputs + input]! : 0);
      }),
    );
  for (let block = 0; block < out.blocks; block++) {
    const terms = [printer.vec4(...[0, 1, 2, 3].map((i) => literal(bias[4 * block + i] ?? 0)))];
    for (let i = 0; i < a.blocks; i++) {
      if (inputs - 4 * i === 1) terms.push(`${column(block, 4 * i)} * ${a.at(4 * i)}`);
      else
        terms.push(language.transform([0, 1, 2, 3].map((c) => column(block, 4 * i + c)), a.block(i)));
    }
    printer.store(out, block, terms.join("\n    + "));
  }
}

/** Texels of a layer's weights. */
function layerSize({ outputs, inputs, experts }: ReturnType<typeof sizes>): number {
  return experts * Math.ceil(outputs / 4) * (1 + 4 * Math.ceil(inputs / 4));
}

/** [experts][blocks of outputs][bias, then a column per input, padded to a multiple of four], as texels. */
function layerTexels(use: Use): Float32Array {
  const { outputs, inputs, experts } = sizes(use);
  const weights = valuesOf(use.buffer.weights!);
  const bias = valuesOf(use.buffer.bias!);
  const blocks = Math.ceil(outputs / 4);
  const row = 1 + 4 * Math.ceil(inputs / 4);
  const out = new Float32Array(4 * experts * blocks * row);
  for (let e = 0; e < experts; e++) {
    for (let o = 0; o < outputs; o++) {
      const at = 4 * (e * blocks + (o >> 2)) * row + (o & 3);
      out[at] = bias[e * outputs + o]!;
      for (let i = 0; i < inputs; i++) out[at + 4 * (1 + i)] = weights[(e * outputs + o) * inputs + i]!;
    }
  }
  return out;
}

/** Loops over texels; the offset of an expert's rows depends on the pixel. */
function printTable(
  use: Use,
  printer: Printer,
  out: Value,
  given: Value,
  language: Language,
  index?: Value,
): void {
  const half = use.buffer.weights!.type === "float16" && use.buffer.bias!.type === "float16";
  const table = printer.table([use.buffer.weights!, use.buffer.bias!], half, layerSize(sizes(use)), () => layerTexels(use));
  const { experts } = sizes(use);
  const a = printer.indexable(given);
  const row = 1 + 4 * a.blocks;
  const [base, sum] = [printer.temporary(), printer.temporary()];
  const expert = index && printRoundedIndex(index, experts, language);
  printer.array(out);
  printer.emit(
    language.constant("int", base, `${table.first}${expert ? ` + ${expert} * ${out.blocks * row}` : ""}`),
  );
  printer.loop(out.blocks, (o) => {
    const at = printer.temporary();
    printer.emit("{");
    printer.emit(language.constant("int", at, `${base} + ${o} * ${row}`));
    printer.emit(language.variable("vec4", sum, table.texel(at)));
    printer.loop(a.blocks, (i) => {
      const [first, x] = [printer.temporary(), printer.temporary()];
      printer.emit(language.constant("int", first, `${at} + 4 * ${i}`));
      printer.emit(language.constant("vec4", x, a.block(a.storage === "split" ? 0 : i)));
      const terms = ["x", "y", "z", "w"].map((c, k) => `${table.texel(`${first} + ${k + 1}`)} * ${x}.${c}`);
      printer.emit(`${sum} += ${terms.join(" + ")};`);
    });
    printer.emit(`${out.block(o)} = ${sum};`, "}");
  });
}

export const linear: Op = {
  arity: [1, 2],
  parameters: { weights: { kind: "buffer", ranks: [2, 3] }, bias: { kind: "buffer", ranks: [1, 2] } },
  width(use) {
    const weights = use.buffer.weights!.shape;
    const bias = use.buffer.bias!.shape;
    const indexed = use.widths.length === 2;
    use.expect(
      weights.length === (indexed ? 3 : 2),
      "weights [experts, out, in] with an index, [out, in] without",
    );
    use.expect(weights.at(-1) === use.widths[0], `weights for inputs of width ${use.widths[0]}`);
    use.expect(bias.join() === weights.slice(0, -1).join(), `a bias of shape ${weights.slice(0, -1)}`);
    use.expect(!indexed || use.widths[1] === 1, "an index of width 1");
    return weights.at(-2)!;
  },
  macs: (use) => sizes(use).outputs * sizes(use).inputs,
  evaluate(use, [a, index], width) {
    const { inputs, experts } = sizes(use);
    const expert = index ? roundedIndex(index[0]!, experts) : 0;
    const weights = valuesOf(use.buffer.weights!).subarray(expert * width * inputs);
    const bias = valuesOf(use.buffer.bias!).subarray(expert * width);
    const out = new Float32Array(width);
    for (let o = 0; o < width; o++) {
      let sum = bias[o]!;
      for (let i = 0; i < inputs; i++) sum += weights[o * inputs + i]! * a![i]!;
      out[o] = sum;
    }
    return out;
  },
  print(use, printer, out, [a, index], language) {
    if (printer.weights === "inline" && !index) printInline(use, printer, out, a!, language);
    else printTable(use, printer, out, a!, language, index);
  },
};

/** Writes all products of a matrix of the frame out: beside weights in the text, loops would index arrays. */
function printWrittenOut(printer: Printer, out: Value, m: Value, a: Value): void {
  for (let o = 0; o < out.blocks; o++) {
    const rows = (i: number) => [0, 1, 2, 3].map((r) => `dot(${m.block((4 * o + r) * a.blocks + i)}, ${a.block(i)})`);
    const terms = Array.from({ length: a.blocks }, (_, i) => printer.vec4(...rows(i)));
    printer.store(out, o, terms.join("\n    + "));
  }
}

/** Reads a matrix of the frame in loops: it may live in a texture, where unrolled fetches are ruinous. */
function printLoopedMatvec(printer: Printer, out: Value, m: Value, a: Value, language: Language): void {
  printer.zeros(out);
  printer.loop(out.blocks, (o) =>
    printer.loop(a.blocks, (i) => {
      const x = printer.temporary();
      printer.emit("{", language.constant("vec4", x, a.block(a.storage === "split" ? 0 : i)));
      const terms = [0, 1, 2, 3].map(
        (r) => `dot(${m.block(`(4 * ${o} + ${r}) * ${a.blocks} + ${i}`)}, ${x})`,
      );
      printer.emit(`${out.block(o)} += ${printer.vec4(...terms)};`, "}");
    }),
  );
}

export const matvec: Op = {
  arity: [2, 2],
  parameters: { rows: { kind: "integer", low: 1, high: MAX_WIDTH } },
  width(use) {
    const [matrix, columns] = use.widths as [number, number];
    use.expect(matrix === use.number.rows! * columns, `a matrix of ${use.number.rows! * columns} numbers`);
    return use.number.rows!;
  },
  macs: (use) => use.number.rows! * use.widths[1]!,
  evaluate: (_use, [m, a], width) =>
    Array.from({ length: width }, (_, r) => a!.reduce((sum, x, c) => sum + m![r * a!.length + c]! * x, 0)),
  print(use, printer, out, [matrix, vector], language) {
    const columns = use.widths[1]!;
    if (matrix!.storage === "call" && columns % 4 === 0 && out.width % 4 === 0) {
      if (printer.weights === "inline") printWrittenOut(printer, out, matrix!, vector!);
      else printLoopedMatvec(printer, out, matrix!, printer.indexable(vector!), language);
      return;
    }
    const [m, a] = [printer.local(matrix!), vector];
    const row = (r: number) => {
      if (columns % 4 === 0) {
        const blocks = Array.from({ length: columns / 4 }, (_, i) => i);
        return blocks.map((i) => `dot(${m!.block((r * columns) / 4 + i)}, ${a!.block(i)})`).join(" + ");
      }
      return a!
        .components()
        .map((x, c) => `${m!.at(r * columns + c)} * ${x}`)
        .join(" + ");
    };
    printer.perComponent(
      out,
      Array.from({ length: out.width }, (_, r) => row(r)),
    );
  },
};
