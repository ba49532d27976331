/** The op oneblob: a normal distribution around a coordinate, integrated over bins. */

import { type Language, literal } from "../../language.ts";
import type { Op } from "../../op.ts";
import type { Printer } from "../../printer.ts";
import { horner } from "../sincos.ts";

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
