/** Ops that only move components: concat, slice. */

import { MAX_WIDTH, type Op } from "../../op.ts";

export const concat: Op = {
  arity: [1, 256],
  width: (use) => use.widths.reduce((a, b) => a + b, 0),
  evaluate: (_use, inputs) => inputs.flatMap((input) => [...input]),
  print(_use, printer, out, inputs) {
    if (inputs.every((input, i) => i === inputs.length - 1 || input.width % 4 === 0)) {
      let block = 0;
      for (const input of inputs) {
        for (let i = 0; i < input.blocks; i++) printer.store(out, block++, input.block(i));
      }
      return;
    }
    printer.perComponent(
      out,
      inputs.flatMap((input) => input.components()),
    );
  },
};

export const slice: Op = {
  arity: [1, 1],
  parameters: {
    start: { kind: "integer", low: 0, high: MAX_WIDTH },
    width: { kind: "integer", low: 1, high: MAX_WIDTH },
  },
  width(use) {
    const { start, width } = use.number as { start: number; width: number };
    use.expect(start + width <= use.widths[0]!, `start + width <= ${use.widths[0]}, the width of the input`);
    return width;
  },
  evaluate: (use, [a]) => a!.subarray(use.number.start!, use.number.start! + use.number.width!),
  print(use, printer, out, [a]) {
    printer.perComponent(
      out,
      a!.components().slice(use.number.start!, use.number.start! + use.number.width!),
    );
  },
};
