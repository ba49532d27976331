/** A declared light in an engine other than three.js. */

import type { Vec3 } from "../checks.ts";
import type { Variable } from "../variables.ts";

/** Where a lamp is, in the space of the file, and how it shines. */
export class EngineLamp {
  readonly variable: Variable;
  /** A position in metres, or a unit direction to the sun. */
  readonly value: [number, number, number];
  /** Linear. */
  color: [number, number, number];
  /** Candela, or lux. */
  intensity: number;

  constructor(variable: Variable) {
    this.variable = variable;
    this.value = [0, 0, 0];
    this.color = [...variable.color];
    this.intensity = variable.intensity;
    this.move(variable.initial);
  }

  /** Move the lamp; returns whether the wish had to be clamped to what was learned. */
  move(wish: Vec3): boolean {
    const { variable, value } = this;
    const length = Math.hypot(...wish) || 1;
    wish.forEach((x, i) => {
      value[i] = variable.kind === "point" ? Math.min(variable.high[i]!, Math.max(variable.low[i]!, x)) : x / length;
    });
    return variable.kind === "point" && value.some((x, i) => Math.abs(x - wish[i]!) > 1e-6);
  }
}
