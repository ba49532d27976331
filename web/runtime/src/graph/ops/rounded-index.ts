/** A number as the index of one of several things. */

import { type Language, literal } from "../language.ts";
import type { Value } from "../printer.ts";

/** Which of `count` things an index means: rounded half up, clamped to what there is. */
export function roundedIndex(index: number, count: number): number {
  return Math.min(Math.max(Math.floor(Math.fround(index + 0.5)), 0), count - 1);
}

/** As `roundedIndex`, in a shader. */
export function printRoundedIndex(index: Value, count: number, language: Language): string {
  return `${language.type("int")}(clamp(floor(${index.at(0)} + 0.5), 0.0, ${literal(count - 1)}))`;
}
