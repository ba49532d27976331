/** Finds the lamp that turns an environment map; the lamp itself is loaded where there is one. */

import type { Lamp } from "./lamp.ts";
import type { TurningLamp } from "./turning-lamp.ts";

/** The environment map among lamps that turns; null where none does. */
export function turningOf(lamps: readonly Lamp[]): TurningLamp | null {
  return (lamps.find(({ variable }) => variable.kind === "environment") ?? null) as TurningLamp | null;
}
