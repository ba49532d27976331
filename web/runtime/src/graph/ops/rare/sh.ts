/** The op sh: spherical harmonics of a direction. */

import { literal } from "../../language.ts";
import type { Op } from "../../op.ts";

const root = (numerator: number, denominator: number) => Math.sqrt(numerator / (denominator * Math.PI));
const SH_0 = root(1, 4);
const SH_1 = root(3, 4);
const SH_2 = [root(15, 4), root(5, 16), root(15, 16)] as const;
const SH_3 = [root(35, 32), root(105, 4), root(21, 32), root(7, 16), root(105, 16)] as const;

/** Each harmonic as a factor and a polynomial, in the order and with the signs of Sloan, JCGT 2(2), 2013. */
const HARMONICS: readonly [number, string, (x: number, y: number, z: number) => number][] = [
  [SH_0, "1.0", () => 1],
  [-SH_1, "y", (_x, y) => y],
  [SH_1, "z", (_x, _y, z) => z],
  [-SH_1, "x", (x) => x],
  [SH_2[0], "x * y", (x, y) => x * y],
  [-SH_2[0], "y * z", (_x, y, z) => y * z],
  [SH_2[1], "(3.0 * z * z - 1.0)", (_x, _y, z) => 3 * z * z - 1],
  [-SH_2[0], "x * z", (x, _y, z) => x * z],
  [SH_2[2], "(x * x - y * y)", (x, y) => x * x - y * y],
  [-SH_3[0], "y * (3.0 * x * x - y * y)", (x, y) => y * (3 * x * x - y * y)],
  [SH_3[1], "x * y * z", (x, y, z) => x * y * z],
  [-SH_3[2], "y * (5.0 * z * z - 1.0)", (_x, y, z) => y * (5 * z * z - 1)],
  [SH_3[3], "z * (5.0 * z * z - 3.0)", (_x, _y, z) => z * (5 * z * z - 3)],
  [-SH_3[2], "x * (5.0 * z * z - 1.0)", (x, _y, z) => x * (5 * z * z - 1)],
  [SH_3[4], "z * (x * x - y * y)", (x, y, z) => z * (x * x - y * y)],
  [-SH_3[0], "x * (x * x - 3.0 * y * y)", (x, y) => x * (x * x - 3 * y * y)],
];

export const sh: Op = {
  arity: [1, 1],
  parameters: { degree: { kind: "integer", low: 1, high: 4 } },
  width(use) {
    use.expect(use.widths[0] === 3, "a direction of width 3");
    return use.number.degree! ** 2;
  },
  evaluate: (use, [d]) =>
    HARMONICS.slice(0, use.number.degree! ** 2).map(
      ([factor, , meaning]) => factor * meaning(d![0]!, d![1]!, d![2]!),
    ),
  print(_use, printer, out, [d]) {
    const names = { x: d!.at(0), y: d!.at(1), z: d!.at(2) };
    const text = (polynomial: string) =>
      polynomial.replace(/[xyz]/g, (axis) => names[axis as "x" | "y" | "z"]);
    printer.perComponent(
      out,
      HARMONICS.slice(0, out.width).map(([factor, polynomial]) => `${literal(factor)} * ${text(polynomial)}`),
    );
  },
};
