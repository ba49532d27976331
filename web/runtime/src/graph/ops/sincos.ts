/** Sine and cosine as shaders compute them, as exact as 32-bit floats. */

import { type Language, literal } from "../language.ts";
import type { Printer } from "../printer.ts";

/** Taylor coefficients of sin(πf)/f and cos(πf) in f²: to 3e-8 for |f| ≤ 1/4. */
const SINE = [1, -1 / 6, 1 / 120, -1 / 5040, 1 / 362880].map((c, i) => c * Math.PI ** (2 * i + 1));
const COSINE = [1, -1 / 2, 1 / 24, -1 / 720, 1 / 40320].map((c, i) => c * Math.PI ** (2 * i));

/** A polynomial by Horner's rule. */
export const horner = (coefficients: readonly number[], x: string): string =>
  coefficients.reduceRight((text, c) => (text ? `(${literal(c)} + ${x} * ${text})` : literal(c)), "");

/**
 * Helper that returns (sin πa, cos πa, sin πb, cos πb) of (a, b). The built-in sine of a GPU may be off by 2⁻¹¹ and worse
 * for large arguments: reduce to the nearest quarter turn, which is exact, and use polynomials.
 */
export function sincos(printer: Printer, language: Language): string {
  return printer.helper("sincos", (name) =>
    language.function(
      "vec4",
      name,
      [["vec2", "t"]],
      [
        language.constant("vec2", "q", "floor(t * 2.0 + 0.5)"),
        language.constant("vec2", "f", "t - q * 0.5"),
        language.constant("vec2", "g", "f * f"),
        language.constant("vec2", "s", `f * ${horner(SINE, "g")}`),
        language.constant("vec2", "c", horner(COSINE, "g")),
        language.constant("vec2", "m", "q - 4.0 * floor(q * 0.25)"),
        language.constant("vec2", "upper", "floor(m * 0.5)"),
        language.constant("vec2", "odd", "m - 2.0 * upper"),
        language.constant("vec2", "flip", "1.0 - 2.0 * upper"),
        language.constant("vec2", "y", `flip * ${language.mix}(s, c, odd)`),
        language.constant("vec2", "x", `flip * ${language.mix}(c, -s, odd)`),
        `return ${language.type("vec4")}(y.x, x.x, y.y, x.y);`,
      ],
    ),
  );
}
