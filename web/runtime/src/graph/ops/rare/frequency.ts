/** The op frequency: sines and cosines of octaves. */

import { literal } from "../../language.ts";
import type { Op } from "../../op.ts";
import { sincos } from "../sincos.ts";

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
