/** Where a lamp is put that nobody declared: light adds up, so a field plays back any number of lamps of its kind. */

import { Color, Vector3 } from "three";
import { type Lamp, PointLamp, SunLamp } from "./lamp.ts";

/** Linear colours of added lamps, as multiples of the declared one: cool, rose, green, so that each can be told apart. */
const TINTS = [
  [0.12, 0.38, 1.3],
  [1.3, 0.2, 0.4],
  [0.25, 1.1, 0.35],
] as const;

/** Intensity of an added lamp, as a share of the declared one: two of them still suit the exposure. */
export const ADDED_SHARE = 0.5;

/** Shares of the box, or of the arc, where a new lamp may go. */
const PLACES = [0.2, 0.5, 0.8];

/** The place of a lamp's kind that is farthest from all others. */
export function roomiestPlace(lamp: Lamp, others: readonly Lamp[]): Vector3 {
  const places = lamp instanceof PointLamp ? pointPlaces(lamp) : sunPlaces(lamp as SunLamp);
  const room = (place: Vector3) => Math.min(...others.map((other) => other.value.distanceTo(place)), Infinity);
  return places.reduce((best, place) => (room(place) > room(best) ? place : best));
}

/** Colour of the lamp number `index` of a kind, where 0 is the declared one. */
export function tintOf(declared: Color, index: number): Color {
  if (index === 0) return declared.clone();
  const [r, g, b] = TINTS[(index - 1) % TINTS.length]!;
  return declared.clone().multiply(new Color(r, g, b));
}

/** A coarse lattice in the box, at the height of the declared light, where there is air. */
function pointPlaces({ variable }: PointLamp): Vector3[] {
  const [low, high] = [new Vector3(...variable.low), new Vector3(...variable.high)];
  const at = (axis: "x" | "z", share: number) => low[axis] + share * (high[axis] - low[axis]);
  return PLACES.flatMap((x) => PLACES.map((z) => new Vector3(at("x", x), variable.initial[1], at("z", z))));
}

function sunPlaces({ arc }: SunLamp): Vector3[] {
  return PLACES.map((t) => arc.at(t));
}
