/** Names that someone gives a variable and that the file does not have: said once on the console, with those that it has. */

import type { Lamp } from "./lamp.ts";
import { turningOf } from "./turning-of.ts";

/** What varies in a scene, as far as names go. */
interface Varying {
  readonly lamps: readonly Lamp[];
  readonly switches: readonly { readonly name: string }[];
  readonly movers: readonly { readonly name: string }[];
}

/** Attributes of libraries that share the page (Vue, Angular, Alpine, htmx, …), and those that HTML lets everyone add. */
const FOREIGN = /^(?:data|aria|on|item|v|ng|x|hx)-|^(?:on|item)[a-z]|[:@_.]/i;

/** Whether an attribute is not meant for us. */
export const isForeign = (name: string): boolean => FOREIGN.test(name);

/** Remembers what was said for one file. */
export class UnknownNames {
  private readonly said = new Set<string>();
  private readonly where: string;
  private readonly rotation: string;
  private readonly scene: Varying;
  private readonly shorts: readonly string[];

  /** `where` begins every line; `shorts` are the short forms of what moves; `rotation` is what the turn of an environment is called. */
  constructor(where: string, scene: Varying, shorts: Iterable<string>, rotation: string) {
    this.where = where;
    this.rotation = rotation;
    this.scene = scene;
    this.shorts = [...shorts];
  }

  /** Warn of properties or attributes that are neither known nor a short form. */
  props(given: Iterable<string>, known: (name: string) => boolean): void {
    for (const name of given) if (!this.shorts.includes(name) && !known(name)) this.say(name, "property", this.variables());
  }

  /** Warn of names in `lamps`. */
  lamps(given: Iterable<string>): void {
    this.named(given, "lamp", this.scene.switches.map(({ name }) => name));
  }

  /** Warn of names in `movers`. */
  movers(given: Iterable<string>): void {
    this.named(given, "mover", this.scene.movers.map(({ name }) => name));
  }

  private named(given: Iterable<string>, kind: string, names: readonly string[]): void {
    for (const name of given) if (!names.includes(name)) this.say(name, kind, names);
  }

  private say(name: string, kind: string, names: readonly string[]): void {
    const key = `${kind} ${name}`;
    if (this.said.has(key)) return;
    this.said.add(key);
    const there = names.map((other) => `'${other}'`).join(", ") || "none";
    const what = kind === "property" ? "is no property, and nothing of this name varies in the file; what varies" : `is no ${kind} of the file; there are`;
    console.warn(`${this.where}: '${name}' ${what}: ${there}`);
  }

  /** The properties that change this file: short forms first. */
  private variables(): string[] {
    const { lamps, switches, movers } = this.scene;
    const asked: readonly (readonly [name: string, is: boolean])[] = [
      ["light", lamps.some(({ variable }) => variable.kind === "point")],
      ["day", lamps.some(({ variable }) => variable.kind === "sun" && Boolean(variable.sky?.hours))],
      [this.rotation, turningOf(lamps) !== null],
      ["lamps", switches.length > 0],
      ["movers", movers.length > 0],
    ];
    return [...this.shorts, ...asked.flatMap(([name, is]) => (is ? [name] : []))];
  }
}
