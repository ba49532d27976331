/** An environment map that turns about the vertical axis: the variable of kind `environment`. */

import { direction, fail, list, number, type Vec3 } from "./checks.ts";

export interface TurningVariable {
  readonly kind: "environment";
  readonly name: string;
  /** First and last angle, degrees clockwise seen from above. */
  readonly range: readonly [number, number];
  /** Where the map's north (-Z) points to first: a horizontal unit vector. */
  readonly initial: Vec3;
  /** Factor of the map. */
  readonly intensity: number;
  /** Linear sRGB. */
  readonly color: Vec3;
}

const WHOLE_TURN = 360;
/** Degrees by which an angle may miss the range. */
const NEAR = 1e-3;

/** Read what only this kind has. */
export function readTurning(entry: Record<string, unknown>, where: string, common: Pick<TurningVariable, "name" | "intensity" | "color">): TurningVariable {
  if (entry.sky !== undefined) fail(`${where}.sky`, "nothing of that name in an environment");
  const angles = list(entry.range, `${where}.range`, 2).map((angle, i) => number(angle, `${where}.range[${i}]`, -WHOLE_TURN, WHOLE_TURN));
  const [first, last] = angles;
  if (first === undefined || last === undefined || first >= last || last - first > WHOLE_TURN) return fail(`${where}.range`, "two increasing angles, at most 360 degrees apart");
  return { kind: "environment", ...common, range: [first, last], initial: direction(entry.initial ?? northAt(Math.min(Math.max(0, first), last)), `${where}.initial`) };
}

/** Where the map's north points to when it is turned by an angle in degrees. */
export function northAt(angle: number): [number, number, number] {
  const turn = (angle * Math.PI) / 180;
  return [Math.sin(turn), 0, -Math.cos(turn)];
}

/** The angle of a direction of the map's north, degrees in the range; the nearest end beside it. */
export function angleOf({ range: [first, last] }: Pick<TurningVariable, "range">, [x, , z]: Vec3): number {
  const beyond = (Math.atan2(x, -z) * 180) / Math.PI - first;
  const found = first + ((beyond % WHOLE_TURN) + WHOLE_TURN) % WHOLE_TURN;
  if (found - first > WHOLE_TURN - NEAR) return first;
  if (found <= last) return found;
  return found - last > (WHOLE_TURN + first - last) / 2 ? first : last;
}

/** The angle in the range for one that someone asks for, whole turns aside; null where the map is not turned so far. */
export function angleInRange({ range: [first, last] }: Pick<TurningVariable, "range">, asked: number): number | null {
  const found = [asked, asked - WHOLE_TURN, asked + WHOLE_TURN].find((angle) => angle >= first - NEAR && angle <= last + NEAR);
  return found === undefined ? null : Math.min(Math.max(found, first), last);
}
