/** The short form of what moves: a property or an attribute with its own name, 0 to 1 of its range. */

import type { Mover } from "./movers.ts";

/** Its name as a property: in lower case, and `-` for all that is no letter or digit (`Sliding door.001`: `sliding-door-001`). */
export function moverProp(name: string): string {
  return name.toLowerCase().replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "");
}

/**
 * The movers by their short forms. One whose short form is `taken`, or that of another, has none: one line in the console says so.
 * `where` begins that line.
 */
export function moverProps(movers: readonly Mover[], taken: (prop: string) => boolean, where: string): Map<string, Mover> {
  const found = new Map<string, Mover>();
  for (const mover of movers) {
    const prop = moverProp(mover.name);
    if (prop && !taken(prop) && !found.has(prop)) found.set(prop, mover);
    else console.warn(`${where}: '${mover.name}' has no short form, because '${prop}' ${prop ? "is taken" : "is no name"}; set it through 'movers', or rename its node`);
  }
  return found;
}

/** Put every mover to its share of the short form, else to the value of its name, else where the file shows it first. */
export function setMovers(movers: readonly Mover[], values: (name: string) => number | undefined, shares: ReadonlyMap<Mover, number>): void {
  for (const mover of movers) {
    const [first, last] = mover.record.range;
    const share = shares.get(mover);
    mover.value = share === undefined ? (values(mover.name) ?? mover.record.initial) : first + (last - first) * share;
  }
}
