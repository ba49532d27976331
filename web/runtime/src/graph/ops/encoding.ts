/** Encodings of low-dimensional inputs: frequency, oneblob, sh. */

import { type Language, literal } from "../language.ts";
import type { Op } from "../op.ts";
import type { Printer } from "../printer.ts";
import { horner, sincos } from "./sincos.ts";

export const frequency: Op = {
  arity: [1, 1],
  parameters: { octaves: { kind: "integer", low: 1, high: 24 } },
  width: (use) => use.widths[0]! * use.number.octaves! * 2,
  evaluate(use, [a]) {
    return [...a!].flatMap((c) =>
      Array.from({ length: use.number.octaves! }, (_, k) => {
        const turns = c * 2 ** k;
        const angle = Math.PI * (turns - 2 * Math.round(turns / 2));
        return [Math.sin(angle), Math.cos(angle)];
      }).flat(),
    );
  },
  print(use, printer, out, [a], language) {
    const name = sincos(printer, language);
    const octaves = Array.from({ length: use.number.octaves! }, (_, k) => literal(2 ** k));
    const turns = a!.components().flatMap((c) => octaves.map((factor) => `${c} * ${factor}`));
    for (let i = 0; i < out.blocks; i++) {
      const second = turns[2 * i + 1];
      const text = `${name}(${language.type("vec2")}(${turns[2 * i]}, ${second ?? "0.0"}))`;
      printer.store(out, i, second ? text : printer.padded(2, text));
    }
  },
};

/** Abramowitz and Stegun, Handbook of Mathematical Functions, 7.1.26: erf to 1.5e-7. */
const ERF_P = 0.3275911;
const ERF_A = [0.254829592, -0.284496736, 1.421413741, -1.453152027, 1.061405429];

/** Half of erf(x / √2): the normal distribution below x, less a half. */
function below(x: number): number {
  const z = Math.abs(x) * Math.SQRT1_2;
  const t = 1 / (1 + ERF_P * z);
  const polynomial = ERF_A.reduceRight((value, a) => t * (a + value), 0);
  return 0.5 * Math.sign(x) * (1 - polynomial * Math.exp(-z * z));
}

function belowHelper(printer: Printer, language: Language): string {
  return printer.helper("below", (name) =>
    language.function(
      "vec4",
      name,
      [["vec4", "x"]],
      [
        language.constant("vec4", "z", `abs(x) * ${literal(Math.SQRT1_2)}`),
        language.constant("vec4", "t", `1.0 / (1.0 + ${literal(ERF_P)} * z)`),
        language.constant("vec4", "p", `t * ${horner(ERF_A, "t")}`),
        "return 0.5 * sign(x) * (1.0 - p * exp(-z * z));",
      ],
    ),
  );
}

export const oneblob: Op = {
  arity: [1, 1],
  parameters: { bins: { kind: "integer", low: 2, high: 256 } },
  width: (use) => use.widths[0]! * use.number.bins!,
  evaluate(use, [a]) {
    const bins = use.number.bins!;
    return [...a!].flatMap((c) =>
      Array.from({ length: bins }, (_, i) => below(i + 1 - c * bins) - below(i - c * bins)),
    );
  },
  print(use, printer, out, [a], language) {
    const bins = use.number.bins!;
    const name = belowHelper(printer, language);
    const components: string[] = [];
    for (const c of a!.components()) {
      for (let i = 0; i < bins; i += 4) {
        const [edge, value] = [printer.temporary(), printer.temporary()];
        const edges = printer.vec4(...[0, 1, 2, 3].map((j) => literal(i + j)));
        printer.emit(language.constant("vec4", edge, `${edges} - ${c} * ${literal(bins)}`));
        printer.emit(language.constant("vec4", value, `${name}(${edge} + 1.0) - ${name}(${edge})`));
        components.push(
          ..."xyzw"
            .slice(0, Math.min(4, bins - i))
            .split("")
            .map((j) => `${value}.${j}`),
        );
      }
    }
    printer.perComponent(out, components);
  },
};

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
