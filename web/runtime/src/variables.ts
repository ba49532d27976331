/** What may move at run time: the declared lights of a baked asset. */

import { direction, fail, list, number, record, text, type Vec3, vec3 } from "./checks.ts";
import { MAX_VARIABLES } from "./most.ts";
import { readSky, type Sky } from "./sky.ts";
import { readTurning, type TurningVariable } from "./turning.ts";

/** A small light that roams a box. */
export interface PointVariable {
  readonly kind: "point";
  readonly name: string;
  /** Smallest corner of the box, metres. */
  readonly low: Vec3;
  /** Largest corner of the box, metres. */
  readonly high: Vec3;
  /** Distance that the light keeps from every surface, metres. */
  readonly clearance: number;
  /** Radius of the emitting sphere, metres; 0 is a point. */
  readonly radius: number;
  readonly initial: Vec3;
  /** Candela. */
  readonly intensity: number;
  /** Linear sRGB. */
  readonly color: Vec3;
}

/** A distant light on an arc of directions. */
export interface SunVariable {
  readonly kind: "sun";
  readonly name: string;
  /** Unit directions to the sun at t = 0, ½ and 1. */
  readonly start: Vec3;
  readonly middle: Vec3;
  readonly end: Vec3;
  /** Sky and colour of the sun along the arc; null for a white sun alone. */
  readonly sky: Sky | null;
  readonly initial: Vec3;
  /** Lux at normal incidence; with a sky, what a small sphere receives of both at the brightest time. */
  readonly intensity: number;
  /** Linear sRGB. */
  readonly color: Vec3;
}

export type Variable = PointVariable | SunVariable | TurningVariable;

const MAX_INTENSITY = 1e12;

/** Read the lights of `extension.variables`. */
export function readVariables(value: unknown, where: string): Variable[] {
  // What moves comes after the lights (`movers.ts`).
  const entries = list(value ?? [], where, MAX_VARIABLES).map((entry, i) => record(entry, `${where}[${i}]`));
  const lights = entries.findIndex(({ kind }) => kind === "node" || kind === "clip");
  const found = (lights < 0 ? entries : entries.slice(0, lights)).map((entry, i) => readVariable(entry, `${where}[${i}]`));
  return found.filter(({ kind }) => kind === "environment").length > 1 ? fail(where, "one environment that turns") : found;
}

function readVariable(value: unknown, where: string): Variable {
  const entry = record(value, where);
  const common = {
    name: text(entry.name ?? "light", `${where}.name`),
    intensity: number(entry.intensity ?? 1, `${where}.intensity`, 0, MAX_INTENSITY),
    color: vec3(entry.color ?? [1, 1, 1], `${where}.color`),
  };
  if (entry.kind === "point") return readPoint(entry, where, common);
  if (entry.kind === "sun") return readSun(entry, where, common);
  if (entry.kind === "environment") return readTurning(entry, where, common);
  return fail(`${where}.kind`, '"point", "sun" or "environment"');
}

type Common = Pick<PointVariable, "name" | "intensity" | "color">;

function readPoint(entry: Record<string, unknown>, where: string, common: Common): PointVariable {
  if (entry.sky !== undefined) fail(`${where}.sky`, "nothing of that name in a point");
  const low = vec3(entry.low, `${where}.low`);
  const high = vec3(entry.high, `${where}.high`);
  if (low.some((x, i) => x > high[i]!)) fail(`${where}.low`, "no component above `high`");
  const middle: Vec3 = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2];
  return {
    kind: "point",
    ...common,
    low,
    high,
    clearance: number(entry.clearance ?? 0, `${where}.clearance`, 0),
    radius: number(entry.radius ?? 0, `${where}.radius`, 0),
    initial: vec3(entry.initial ?? middle, `${where}.initial`),
  };
}

function readSun(entry: Record<string, unknown>, where: string, common: Common): SunVariable {
  const middle = direction(entry.middle, `${where}.middle`);
  return {
    kind: "sun",
    ...common,
    start: direction(entry.start, `${where}.start`),
    middle,
    end: direction(entry.end, `${where}.end`),
    sky: readSky(entry.sky, `${where}.sky`),
    initial: direction(entry.initial ?? middle, `${where}.initial`),
  };
}
