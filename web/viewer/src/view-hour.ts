/** The time of day of a saved view: its path-traced picture has one hour, whatever the slider says. */

import { clockText, hourAt, type Lamp, sunsWithSky } from "lightwell";
import { Vector3 } from "three";
import type { ViewData } from "./page-data.ts";

/** Hours by which times may differ and still be the same minute. */
const SAME = 1 / 60;

/** The hour that a sun of these lamps shows; null where none has a clock. */
export function hourOf(lamps: readonly Lamp[]): number | null {
  const [sun] = sunsWithSky(lamps);
  return sun ? hourAt(sun.variable.sky!, sun.time) : null;
}

/** The hour of a saved view. */
export function hourOfView({ light, further }: ViewData, lamps: readonly Lamp[]): number | null {
  const [sun] = sunsWithSky(lamps);
  const value = sun && [light, ...further][lamps.indexOf(sun)];
  return value ? hourAt(sun.variable.sky!, sun.arc.time(new Vector3(...value))) : null;
}

/** The name of a saved view, with its hour where it has one. */
export function nameOfView(view: ViewData, lamps: readonly Lamp[]): string {
  const hour = hourOfView(view, lamps);
  return hour === null ? view.name : `${view.name}, ${clockText(hour)}`;
}

/** What to say when a view with this hour is shown for another that was asked for; null where they agree. */
export function otherHour(view: ViewData, asked: number | null, lamps: readonly Lamp[]): string | null {
  const hour = hourOfView(view, lamps);
  if (hour === null || asked === null || Math.abs(hour - asked) < SAME) return null;
  return `The reference of “${view.name}” was traced for ${clockText(hour)}, not ${clockText(asked)}.`;
}

/** The saved view with a reference whose eye is nearest; of several with one eye, that of the nearest hour. */
export function nearestReference(views: readonly ViewData[], eye: Vector3, lamps: readonly Lamp[]): number {
  const asked = hourOf(lamps);
  const apart = (view: ViewData) => Math.abs((hourOfView(view, lamps) ?? 0) - (asked ?? 0));
  const away = (view: ViewData) => eye.distanceTo(new Vector3(...view.camera.position));
  const known = [...views.keys()].filter((i) => views[i]!.reference);
  const order = (a: ViewData, b: ViewData) => away(a) - away(b) || apart(a) - apart(b);
  return known.sort((i, k) => order(views[i]!, views[k]!))[0] ?? -1;
}
