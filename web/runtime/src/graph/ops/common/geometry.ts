/** Vector ops: dot, length, normalize, reflect. */

import { type Op, one } from "../../op.ts";

/** A vector shorter than this is not brought to unit length, so that zero stays zero. */
const SHORTEST = 1e-8;

const sum = (a: Float32Array, b: Float32Array) => a.reduce((total, x, i) => total + x * b[i]!, 0);

export const dot: Op = {
  arity: [2, 2],
  width: one,
  macs: (use) => use.widths[0]!,
  evaluate: (_use, [a, b]) => [sum(a!, b!)],
  print: (_use, printer, out, [a, b]) => printer.perComponent(out, [printer.dot(a!, b!)]),
};

export const length: Op = {
  arity: [1, 1],
  width: () => 1,
  evaluate: (_use, [a]) => [Math.sqrt(sum(a!, a!))],
  print: (_use, printer, out, [a]) => printer.perComponent(out, [`sqrt(${printer.dot(a!, a!)})`]),
};

export const normalize: Op = {
  arity: [1, 1],
  width: (use) => use.widths[0]!,
  evaluate(_use, [a]) {
    const inverse = 1 / Math.max(Math.sqrt(sum(a!, a!)), SHORTEST);
    return a!.map((x) => x * inverse);
  },
  print(_use, printer, out, [a], language) {
    const inverse = printer.temporary();
    printer.emit(language.constant("float", inverse, `1.0 / max(sqrt(${printer.dot(a!, a!)}), ${SHORTEST})`));
    printer.perBlock(out, [a!], (x) => `${x} * ${inverse}`);
  },
};

export const reflect: Op = {
  arity: [2, 2],
  width(use) {
    one(use);
    return use.widths[0]!;
  },
  evaluate(_use, [n, v]) {
    const twice = 2 * sum(n!, v!);
    return n!.map((x, i) => twice * x - v![i]!);
  },
  print(_use, printer, out, [n, v], language) {
    const twice = printer.temporary();
    printer.emit(language.constant("float", twice, `2.0 * (${printer.dot(n!, v!)})`));
    printer.perBlock(out, [n!, v!], (x, y) => `${twice} * ${x} - ${y}`);
  },
};
