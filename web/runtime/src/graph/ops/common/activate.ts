/** Activation functions: each the meaning on the CPU and the text for a vec4. */

import { type Language, literal } from "../../language.ts";
import { type Op, sameWidth } from "../../op.ts";
import type { Printer } from "../../printer.ts";
import { sincos } from "../sincos.ts";

interface Activation {
  meaning(x: number): number;
  /** Text of the value, given the text of a vec4 (an identifier, an element or a call). */
  text(x: string, printer: Printer, language: Language): string;
}

const sigmoid = (x: number) => 1 / (1 + Math.exp(-x));

/** A helper of one vec4, so that its argument is computed once. */
function call(name: string, body: (printer: Printer, language: Language) => string): Activation["text"] {
  return (x, printer, language) => {
    const full = printer.helper(name, (fullName) =>
      language.function("vec4", fullName, [["vec4", "x"]], [`return ${body(printer, language)};`]),
    );
    return `${full}(${x})`;
  };
}

const bounds = (printer: Printer, low: number, high: number) =>
  `clamp(x, ${printer.vec4(literal(low))}, ${printer.vec4(literal(high))})`;

const ACTIVATIONS: Readonly<Record<string, Activation>> = {
  identity: { meaning: (x) => x, text: (x) => x },
  relu: { meaning: (x) => Math.max(x, 0), text: (x, printer) => `max(${x}, ${printer.vec4("0.0")})` },
  leaky_relu: { meaning: (x) => Math.max(x, 0.01 * x), text: call("leaky_relu", () => "max(x, x * 0.01)") },
  sigmoid: { meaning: sigmoid, text: call("sigmoid", (p) => `1.0 / (1.0 + exp(-${bounds(p, -80, 80)}))`) },
  // Not the built-in: it overflows for large arguments on some devices.
  tanh: {
    meaning: Math.tanh,
    text: call("tanh", (p) => `1.0 - 2.0 / (exp(2.0 * ${bounds(p, -15, 15)}) + 1.0)`),
  },
  silu: {
    meaning: (x) => x * sigmoid(x),
    text: call("silu", (p) => `x / (1.0 + exp(-${bounds(p, -80, 80)}))`),
  },
  softplus: {
    meaning: (x) => Math.max(x, 0) + Math.log1p(Math.exp(-Math.abs(x))),
    text: call("softplus", (p) => `max(x, ${p.vec4("0.0")}) + log(1.0 + exp(-abs(x)))`),
  },
  sine: {
    meaning: Math.sin,
    text: call("sine", (p, language) => {
      const name = sincos(p, language);
      const turns = `x * ${literal(1 / Math.PI)}`;
      return p.vec4(`${name}((${turns}).xy).xz`, `${name}((${turns}).zw).xz`);
    }),
  },
  exp: {
    meaning: (x) => Math.exp(Math.min(Math.max(x, -12), 6)),
    text: call("exp", (p) => `exp(${bounds(p, -12, 6)})`),
  },
};

export const activate: Op = {
  arity: [1, 1],
  parameters: { function: { kind: "choice", choices: Object.keys(ACTIVATIONS) } },
  width: sameWidth,
  evaluate: (use, [a]) => a!.map(ACTIVATIONS[use.choice.function!]!.meaning),
  print(use, printer, out, inputs, language) {
    const { text } = ACTIVATIONS[use.choice.function!]!;
    printer.perBlock(out, inputs, (x) => text(x!, printer, language));
  },
};
