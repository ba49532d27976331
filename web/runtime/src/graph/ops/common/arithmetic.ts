/** Component-wise arithmetic: affine, add, subtract, multiply, scale, clamp, log, reciprocal, select, blend. */

import { literal } from "../../language.ts";
import { MAX_NUMBER, type Op, sameWidth, type Use } from "../../op.ts";

/** Width rule of two operands of which one may have a single component. */
function broadcastWidth(use: Use): number {
  const [a, b] = use.widths as [number, number];
  use.expect(a === b || a === 1 || b === 1, "operands of equal width or of width 1");
  return Math.max(a, b);
}

/** Width rule of a control of width 1 and two values. */
function choiceWidth(use: Use): number {
  use.expect(use.widths[0] === 1, "a first input of width 1");
  use.expect(use.widths[1] === use.widths[2], "two values of equal width");
  return use.widths[1]!;
}

const component = (a: Float32Array, i: number) => a[a.length === 1 ? 0 : i]!;

function binary(text: string, meaning: (a: number, b: number) => number): Op {
  return {
    arity: [2, 2],
    width: broadcastWidth,
    evaluate: (_use, [a, b], width) =>
      Array.from({ length: width }, (_, i) => meaning(component(a!, i), component(b!, i))),
    print: (_use, printer, out, inputs) => printer.perBlock(out, inputs, (a, b) => `${a} ${text} ${b}`),
  };
}

export const add = binary("+", (a, b) => a + b);
export const subtract = binary("-", (a, b) => a - b);
export const multiply = binary("*", (a, b) => a * b);

export const affine: Op = {
  arity: [1, 1],
  parameters: { scale: { kind: "numbers" }, offset: { kind: "numbers" } },
  width: sameWidth,
  evaluate: (use, [a]) =>
    a!.map((x, i) => x * Math.fround(use.numbers.scale![i]!) + Math.fround(use.numbers.offset![i]!)),
  print(use, printer, out, [a]) {
    const block = (numbers: readonly number[], i: number) =>
      printer.vec4(...[0, 1, 2, 3].map((c) => literal(numbers[4 * i + c] ?? 0)));
    for (let i = 0; i < out.blocks; i++) {
      printer.store(
        out,
        i,
        `${a!.block(i)} * ${block(use.numbers.scale!, i)} + ${block(use.numbers.offset!, i)}`,
      );
    }
  },
};

export const scale: Op = {
  arity: [1, 1],
  parameters: { factor: { kind: "number", low: -MAX_NUMBER, high: MAX_NUMBER } },
  width: sameWidth,
  evaluate: (use, [a]) => a!.map((x) => x * Math.fround(use.number.factor!)),
  print: (use, printer, out, inputs) =>
    printer.perBlock(out, inputs, (a) => `${a} * ${literal(use.number.factor!)}`),
};

export const clamp: Op = {
  arity: [1, 1],
  parameters: {
    low: { kind: "number", low: -MAX_NUMBER, high: MAX_NUMBER },
    high: { kind: "number", low: -MAX_NUMBER, high: MAX_NUMBER },
  },
  width(use) {
    use.expect(use.number.low! <= use.number.high!, "low <= high");
    return sameWidth(use);
  },
  evaluate: (use, [a]) => a!.map((x) => Math.min(Math.max(x, use.number.low!), use.number.high!)),
  print(use, printer, out, inputs) {
    const [low, high] = [use.number.low!, use.number.high!].map((x) => printer.vec4(literal(x)));
    printer.perBlock(out, inputs, (a) => `clamp(${a}, ${low}, ${high})`);
  },
};

const EPSILON = { epsilon: { kind: "number", low: 1e-12, high: 1e6 } } as const;

export const log: Op = {
  arity: [1, 1],
  parameters: EPSILON,
  width: sameWidth,
  evaluate: (use, [a]) => a!.map((x) => Math.log(Math.max(x, 0) + use.number.epsilon!)),
  print: (use, printer, out, inputs) =>
    printer.perBlock(
      out,
      inputs,
      (a) => `log(max(${a}, ${printer.vec4("0.0")}) + ${literal(use.number.epsilon!)})`,
    ),
};

export const reciprocal: Op = {
  arity: [1, 1],
  parameters: EPSILON,
  width: sameWidth,
  evaluate: (use, [a]) => a!.map((x) => 1 / (x + use.number.epsilon!)),
  print: (use, printer, out, inputs) =>
    printer.perBlock(out, inputs, (a) => `1.0 / (${a} + ${literal(use.number.epsilon!)})`),
};

export const select: Op = {
  arity: [3, 3],
  width: choiceWidth,
  evaluate: (_use, [c, a, b]) => (c![0]! > 0 ? a! : b!),
  print(_use, printer, out, [c, a, b], language) {
    printer.perBlock(out, [a!, b!], (x, y) => language.choose(`${c!.at(0)} > 0.0`, x!, y!));
  },
};

export const blend: Op = {
  arity: [3, 3],
  width: choiceWidth,
  evaluate: (_use, [t, a, b]) => a!.map((x, i) => x + (b![i]! - x) * t![0]!),
  print: (_use, printer, out, [t, a, b]) =>
    printer.perBlock(out, [a!, b!], (x, y) => `${x} + (${y} - ${x}) * ${t!.at(0)}`),
};
