/** What an op is in the web runtime: arity, parameters, width rule, its meaning on the CPU, and its text in a shader. */

import type { Language } from "./language.ts";
import type { Printer, Value } from "./printer.ts";
import type { StoredBuffer } from "./stored.ts";

export * from "./stored.ts";

/** A parameter of an op. `numbers` has one entry per component of the first input. */
export type Parameter =
  | { readonly kind: "number"; readonly low: number; readonly high: number }
  | { readonly kind: "integer"; readonly low: number; readonly high: number }
  | { readonly kind: "numbers" }
  | { readonly kind: "choice"; readonly choices: readonly string[] }
  /** `picture`: whether the buffer may be a picture. */
  | { readonly kind: "buffer"; readonly ranks: readonly number[]; readonly picture?: boolean };

/** One use of an op: what its functions may know of the node and of what flows into it. */
export interface Use {
  /** Name of the node. */
  readonly id: string;
  /** Numeric parameters. */
  readonly number: Readonly<Record<string, number>>;
  /** Parameters of kind `numbers`. */
  readonly numbers: Readonly<Record<string, readonly number[]>>;
  /** Parameters of kind `choice`. */
  readonly choice: Readonly<Record<string, string>>;
  /** Buffers by parameter name. */
  readonly buffer: Readonly<Record<string, StoredBuffer>>;
  /** Widths of the inputs. */
  readonly widths: readonly number[];
  /** Throw the error of this node unless the condition holds. */
  expect(condition: boolean, expected: string): void;
}

/** An operation of the shading graph. */
export interface Op {
  readonly arity: readonly [number, number];
  readonly parameters?: Readonly<Record<string, Parameter>>;
  /** Width of the value; throws when widths or buffers do not fit. */
  width(use: Use): number;
  /** Multiply-adds per evaluation. */
  macs?(use: Use): number;
  /** Table entries read per evaluation. */
  fetches?(use: Use): number;
  /** The value at one point. */
  evaluate(use: Use, inputs: readonly Float32Array[], width: number): ArrayLike<number>;
  /** Print the statements that fill `out`. */
  print(use: Use, printer: Printer, out: Value, inputs: readonly Value[], language: Language): void;
}

/** Width rule: as wide as the first input. */
export const sameWidth = (use: Use): number => use.widths[0]!;

/** Width rule of inputs that must be equally wide, with a value of one component. */
export function one(use: Use): number {
  use.expect(
    use.widths.every((w) => w === use.widths[0]),
    "inputs of equal width",
  );
  return 1;
}
