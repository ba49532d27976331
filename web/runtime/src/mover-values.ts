/** Values of the nodes that move, as a text. */

import type { Mover } from "./movers.ts";
import { MAX_VARIABLES } from "./most.ts";

/** Values by name from a text such as `Door:45;Slide:0.6`; what is malformed is left out. */
export function readMoverValues(given: string | null): ReadonlyMap<string, number> {
  const found = new Map<string, number>();
  for (const part of (given ?? "").split(";").slice(0, MAX_VARIABLES)) {
    const at = part.lastIndexOf(":");
    const value = part.slice(at + 1).trim() === "" ? Number.NaN : Number(part.slice(at + 1));
    if (at > 0 && Number.isFinite(value)) found.set(decoded(part.slice(0, at).trim()), value);
  }
  return found;
}

/** The same text for movers that are not where the file shows them first; empty when all are. */
export function moverValuesText(movers: readonly Mover[]): string {
  return movers
    .filter(({ value, record: { initial } }) => value !== initial)
    .map(({ name, value }) => `${encodeURIComponent(name)}:${Number(value.toPrecision(5))}`)
    .join(";");
}

function decoded(name: string): string {
  try {
    return decodeURIComponent(name);
  } catch {
    return name;
  }
}
