/** The two largest of many weights and the share of the second: a gate between two experts that leaves no seam. */

import { literal } from "../../language.ts";
import { MAX_NUMBER, type Op } from "../../op.ts";

/** Least sum of two excesses that is divided by: where all weights agree, the first has it all. */
const LEAST_SUM = 1e-8;

export const top2: Op = {
  arity: [1, 1],
  width(use) {
    use.expect(use.widths[0]! >= 2, "at least two weights");
    return 3;
  },
  evaluate(_use, [g]) {
    // Sorting is stable: of equals, the lower index comes first.
    const order = [...g!.keys()].sort((i, k) => g![k]! - g![i]!);
    const third = order.length > 2 ? g![order[2]!]! : 0;
    const [a, b] = [g![order[0]!]! - third, g![order[1]!]! - third];
    const r = b / Math.max(a + b, LEAST_SUM);
    return [order[0]!, order[1]!, r * r * (3 - 2 * r)];
  },
  print(use, printer, out, [given], language) {
    const g = printer.indexable(printer.local(given!));
    const count = use.widths[0]!;
    const float = language.type("float");
    const component = (k: string) => (g.blocks === 1 ? `${g.block(0)}[${k}]` : `${g.block(`(${k} >> 2${language.places})`)}[${k} & 3]`);
    printer.zeros(out);
    // Ranked so far: the two largest with their indices, and the value of the third.
    printer.emit(
      "{",
      language.variable("float", "first", `max(${g.at(0)}, ${g.at(1)})`),
      language.variable("float", "second", `min(${g.at(0)}, ${g.at(1)})`),
      language.variable("float", "third", count > 2 ? literal(-MAX_NUMBER) : "0.0"),
      language.variable("float", "index0", language.choose(`${g.at(0)} >= ${g.at(1)}`, "0.0", "1.0")),
      language.variable("float", "index1", "1.0 - index0"),
    );
    if (count > 2) {
      printer.loop(count - 2, (step) => {
        printer.emit(
          language.constant("int", "k", `${step} + 2`),
          language.constant("float", "x", component("k")),
          `if (x > first) { third = second; second = first; index1 = index0; first = x; index0 = ${float}(k); }`,
          `else if (x > second) { third = second; second = x; index1 = ${float}(k); }`,
          "else { third = max(third, x); }",
        );
      });
    }
    printer.emit(
      language.constant("float", "excess", "second - third"),
      language.constant("float", "r", `excess / max(first - third + excess, ${literal(LEAST_SUM)})`),
      `${out.block(0)} = ${printer.vec4("index0", "index1", "r * r * (3.0 - 2.0 * r)", "0.0")};`,
      "}",
    );
  },
};
