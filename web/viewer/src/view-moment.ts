/** The time of day of a saved view, or the angle of its map: its path-traced picture has one, whatever the slider says. */

import { angleOf, clockText, hourAt, type Lamp, sunsWithSky, turningOf } from "lightwell";
import { Vector3 } from "three";
import type { ViewData } from "./page-data.ts";

/** Hours and degrees by which two may differ and still be the same. */
const SAME_HOUR = 1 / 60;
const SAME_ANGLE = 0.5;

/** A time of day or an angle of the environment map. */
export interface Moment {
  readonly at: number;
  readonly kind: "hour" | "angle";
}

/** The hour that a sun of these lamps shows; null where none has a clock. */
export function hourOf(lamps: readonly Lamp[]): number | null {
  const [sun] = sunsWithSky(lamps);
  return sun ? hourAt(sun.variable.sky!, sun.time) : null;
}

/** The hour or the angle that these lamps show; null where they have neither. */
export function momentOf(lamps: readonly Lamp[]): Moment | null {
  const hour = hourOf(lamps);
  const map = turningOf(lamps);
  if (hour !== null) return { at: hour, kind: "hour" };
  return map && { at: map.angle, kind: "angle" };
}

/** The hour of a saved view, or the angle of its map. */
export function momentOfView({ light, further }: ViewData, lamps: readonly Lamp[]): Moment | null {
  const valueOf = (lamp: Lamp) => [light, ...further][lamps.indexOf(lamp)];
  const [sun] = sunsWithSky(lamps);
  const place = sun && valueOf(sun);
  const hour = place ? hourAt(sun.variable.sky!, sun.arc.time(new Vector3(...place))) : null;
  if (hour !== null) return { at: hour, kind: "hour" };
  const map = turningOf(lamps);
  const north = map && valueOf(map);
  return north ? { at: angleOf(map.variable, north), kind: "angle" } : null;
}

const textOf = ({ at, kind }: Moment): string => (kind === "hour" ? clockText(at) : `${Math.round(at)}°`);

/** Hours or degrees between two; 0 where one of them is not known. */
function apart(a: Moment | null, b: Moment | null): number {
  if (!a || !b || a.kind !== b.kind) return 0;
  const away = Math.abs(a.at - b.at);
  return a.kind === "angle" ? Math.min(away % 360, 360 - (away % 360)) : away;
}

/** The name of a saved view, with its hour or angle where it has one. */
export function nameOfView(view: ViewData, lamps: readonly Lamp[]): string {
  const moment = momentOfView(view, lamps);
  return moment === null ? view.name : `${view.name}, ${textOf(moment)}`;
}

/** What to say when a view with this hour or angle is shown for another that was asked for; null where they agree. */
export function otherMoment(view: ViewData, asked: Moment | null, lamps: readonly Lamp[]): string | null {
  const moment = momentOfView(view, lamps);
  if (moment === null || asked === null || apart(moment, asked) < (moment.kind === "hour" ? SAME_HOUR : SAME_ANGLE)) return null;
  return `The reference of “${view.name}” was traced for ${textOf(moment)}, not ${textOf(asked)}.`;
}

/** The saved view with a reference whose eye is nearest; of several with one eye, that of the nearest hour or angle. */
export function nearestReference(views: readonly ViewData[], eye: Vector3, lamps: readonly Lamp[]): number {
  const asked = momentOf(lamps);
  const away = (view: ViewData) => eye.distanceTo(new Vector3(...view.camera.position));
  const known = [...views.keys()].filter((i) => views[i]!.reference);
  const order = (a: ViewData, b: ViewData) => away(a) - away(b) || apart(momentOfView(a, lamps), asked) - apart(momentOfView(b, lamps), asked);
  return known.sort((i, k) => order(views[i]!, views[k]!))[0] ?? -1;
}
