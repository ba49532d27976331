/**
 * The part of printing that all languages share: named values, helper functions, tables of weights, statements.
 *
 * A value of width C is ⌈C/4⌉ vec4 *blocks*; the components beyond C are zero, so that padded matrices may read them.
 */

import { fail } from "../checks.ts";
import type { Language } from "./language.ts";
import type { StoredBuffer } from "./stored.ts";

/** Where weights live: literals in the text, or tables that loops read. */
export type Weights = "inline" | "table";

/** A value in the shader. */
export class Value {
  readonly name: string;
  readonly width: number;
  /** `split`: one variable per block; `array`: an array of blocks; `call`: read through `name(block)`. */
  storage: "split" | "array" | "call" = "split";
  /** First block of a `call` or `array` value inside its source. */
  first = 0;
  declared = false;

  constructor(name: string, width: number) {
    this.name = name;
    this.width = width;
  }

  /** Number of vec4. */
  get blocks(): number {
    return Math.ceil(this.width / 4);
  }

  /** A block by number, or by the name of a loop variable (not for `split` values). */
  block(index: number | string): string {
    const at =
      typeof index === "number" ? `${index + this.first}` : this.first ? `${this.first} + ${index}` : index;
    if (this.storage === "call") return `${this.name}(${at})`;
    return this.storage === "array" ? `${this.name}[${at}]` : `${this.name}_${index}`;
  }

  /** A component. */
  at(component: number): string {
    return `${this.block(component >> 2)}.${"xyzw"[component & 3]}`;
  }

  /** All components. */
  components(): string[] {
    return Array.from({ length: this.width }, (_, i) => this.at(i));
  }
}

/** Weights or texels of one node in the shared table. */
export interface Table {
  /** Number of the first texel. */
  readonly first: number;
  /** The text that reads a texel, given the text of its number. */
  texel(index: string): string;
}

/** Values of more blocks than any layer of a network has are never written in loops: see `MOST_UNROLLED` of `ops/table-rows.ts`. */
const MOST_LOOPED = 32;

/** Most texels of numbers in a program: a texture of 2048 × 2048, which every WebGL2 device takes. */
export const MAX_TEXELS = 2048 ** 2;

/** All the numbers that loops read, as vec4 texels of one precision. */
export class TexelStore {
  readonly half: boolean;
  readonly parts: Float32Array[] = [];
  texels = 0;

  constructor(half: boolean) {
    this.half = half;
  }

  /** Append numbers (a multiple of four); returns the first texel. */
  add(numbers: Float32Array): number {
    const first = this.texels;
    this.parts.push(numbers);
    this.texels += numbers.length / 4;
    return first;
  }

  /** Everything, padded with zeros to `texels`. */
  concat(texels = this.texels): Float32Array {
    const out = new Float32Array(4 * texels);
    let at = 0;
    for (const part of this.parts) {
      out.set(part, at);
      at += part.length;
    }
    return out;
  }
}

/** Names that the text gives to what is bound, where they are not the program's own. */
export type Names = ReadonlyMap<string, string>;

/** How a text is printed. */
export interface PrinterOptions {
  /** Name of the function and prefix of everything else. */
  readonly prefix: string;
  readonly weights: Weights;
  /** Whether numbers stored as float16 get a table of their own precision. */
  readonly halfTexels?: boolean;
  /** Most characters of the text; printing stops with a `FormatError` before it is exceeded. */
  readonly limit?: number;
  readonly names?: Names;
}

/** Collects the text of one function. */
export class Printer {
  readonly language: Language;
  readonly prefix: string;
  readonly weights: Weights;
  readonly lines: string[] = [];
  /** Helper functions by name, in the order of first use. */
  readonly helpers = new Map<string, string>();
  readonly full = new TexelStore(false);
  readonly half: TexelStore;
  /** Pictures that are sampled, with the names of their samplers. */
  readonly pictures = new Map<StoredBuffer, string>();
  readonly #shared = new Map<string, Table>();
  readonly #numbers = new Map<object, number>();
  #temporaries = 0;

  readonly #limit: number;
  readonly #names: Names;
  #characters = 0;

  constructor(language: Language, options: PrinterOptions) {
    const { prefix, weights, halfTexels = false, limit = Infinity, names = new Map() } = options;
    this.#limit = limit;
    this.#names = names;
    this.language = language;
    this.prefix = prefix;
    this.weights = weights;
    this.half = halfTexels ? new TexelStore(true) : this.full;
  }

  /** The name that something bound has in the text. */
  bound(name: string): string {
    return this.#names.get(name) ?? name;
  }

  emit(...lines: string[]): void {
    for (const line of lines) {
      this.count(line.length + 3);
      this.lines.push(`  ${line}`);
    }
  }

  /** Count characters of the text; throws a `FormatError` when they are too many. */
  count(characters: number): void {
    this.#characters += characters;
    if (this.#characters > this.#limit)
      fail(this.prefix, `a shader of at most ${this.#limit} characters; put its weights into textures or use a smaller field`);
  }

  /** `vec4(…)` in the language. */
  vec4(...parts: string[]): string {
    if (parts.length === 1) return this.language.splat("vec4", parts[0]!);
    return `${this.language.type("vec4")}(${parts.join(", ")})`;
  }

  /** A name that no other statement uses. */
  temporary(): string {
    return `t${this.#temporaries++}`;
  }

  /** Text that reads `width` components as a block with zeros behind them. */
  padded(width: number, text: string): string {
    if (width >= 4) return text;
    return width === 1
      ? this.vec4(`${text}.x`, "0.0", "0.0", "0.0")
      : this.vec4(`${text}.${"xyz".slice(0, width)}`, ...Array(4 - width).fill("0.0"));
  }

  /** Set a block of a value; the first one declares it. */
  store(out: Value, block: number, text: string): void {
    if (!out.declared && this.weights === "table" && out.blocks > 1) this.array(out);
    out.declared = true;
    if (out.storage === "array") this.emit(`${out.block(block)} = ${text};`);
    else this.emit(this.language.variable("vec4", out.block(block), text));
  }

  /** Declare a value as an array, which loops can index. */
  array(out: Value): void {
    out.storage = "array";
    out.declared = true;
    this.emit(this.language.array(out.name, out.blocks));
  }

  /** Set all blocks of a new array value to zero. */
  zeros(out: Value): void {
    this.array(out);
    this.loop(out.blocks, (i) => this.emit(`${out.block(i)} = ${this.vec4("0.0")};`));
  }

  /** A loop over 0 … count − 1; unrolled when it has one step. */
  loop(count: number, body: (index: string) => void): void {
    if (count === 1) {
      body("0");
      return;
    }
    const index = this.temporary();
    this.emit(this.language.loop(index, count));
    body(index);
    this.emit("}");
  }

  /** The same value, such that loops can index it. */
  indexable(value: Value): Value {
    if (value.storage !== "split" || value.blocks === 1) return value;
    const copy = new Value(this.temporary(), value.width);
    this.array(copy);
    for (let i = 0; i < value.blocks; i++) this.emit(`${copy.block(i)} = ${value.block(i)};`);
    return copy;
  }

  /** The same value in local variables: for what is read more than once and lives in a uniform or texture. */
  local(value: Value): Value {
    if (value.storage !== "call") return value;
    const copy = new Value(this.temporary(), value.width);
    this.array(copy);
    this.loop(value.blocks, (i) => this.emit(`${copy.block(i)} = ${value.block(i)};`));
    return copy;
  }

  /** Set every block from the blocks of the inputs; inputs of width 1 are repeated. */
  perBlock(out: Value, inputs: readonly Value[], text: (...blocks: string[]) => string): void {
    const read = (i: number | string) =>
      inputs.map((v) => (v.width === 1 && out.width > 1 ? this.vec4(v.at(0)) : v.block(i)));
    const last = out.blocks - 1;
    const rest = out.width - 4 * last;
    const looped =
      this.weights === "table" &&
      out.blocks > 2 &&
      out.blocks <= MOST_LOOPED &&
      inputs.every((v) => v.width === 1 || v.storage !== "split");
    if (looped) {
      this.array(out);
      this.loop(rest === 4 ? out.blocks : last, (i) => this.emit(`${out.block(i)} = ${text(...read(i))};`));
      if (rest < 4) this.store(out, last, this.padded(rest, `(${text(...read(last))})`));
      return;
    }
    for (let i = 0; i <= last; i++) {
      const value = text(...read(i));
      this.store(out, i, i === last && rest < 4 ? this.padded(rest, `(${value})`) : value);
    }
  }

  /** Set every component. */
  perComponent(out: Value, components: readonly string[]): void {
    for (let i = 0; i < out.blocks; i++) {
      const parts = components.slice(4 * i, 4 * i + 4);
      this.store(out, i, this.vec4(...parts, ...Array(4 - parts.length).fill("0.0")));
    }
  }

  /** Sum of the products of two equally wide values. */
  dot(a: Value, b: Value): string {
    return Array.from({ length: a.blocks }, (_, i) => `dot(${a.block(i)}, ${b.block(i)})`).join(" + ");
  }

  /** Name of a helper function, printed once a program. `text` gets the full name. */
  helper(name: string, text: (fullName: string) => string): string {
    const fullName = `${this.prefix}_${name}`;
    if (!this.helpers.has(fullName)) {
      this.helpers.set(fullName, ""); // reserves the name; helpers it calls come first
      const body = text(fullName);
      this.helpers.delete(fullName);
      this.helpers.set(fullName, body);
      this.count(body.length);
    }
    return fullName;
  }

  /** Put `texels` times four numbers where loops read them; what comes from the same sources is stored once. */
  table(sources: readonly object[], half: boolean, texels: number, numbers: () => Float32Array): Table {
    const key = sources.map((source) => this.#number(source)).join();
    let table = this.#shared.get(key);
    if (!table) {
      const store = half ? this.half : this.full;
      if (store.texels + texels > MAX_TEXELS)
        fail(this.prefix, `at most ${MAX_TEXELS} texels of weights, found ${store.texels + texels}; use a smaller field`);
      const read = `${this.prefix}_${store.half ? "half" : "full"}`;
      table = { first: store.add(numbers()), texel: (index) => `${read}(${index})` };
      this.#shared.set(key, table);
    }
    return table;
  }

  /** Name of the sampler of a picture in the text. */
  picture(buffer: StoredBuffer): string {
    const name = this.pictures.get(buffer) ?? `${this.prefix}_picture${this.pictures.size}`;
    this.pictures.set(buffer, name);
    return this.bound(name);
  }

  /** A number that stands for an object. */
  #number(source: object): number {
    const found = this.#numbers.get(source) ?? this.#numbers.size;
    this.#numbers.set(source, found);
    return found;
  }
}
