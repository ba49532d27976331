/** Sun and sky of a clear day: the numbers that a `sun` variable may carry, and the formula of `Sky` in format/LIGHTWELL_neural_radiance.md. */

import { fail, list, number, record, type Vec3, vec3 } from "./checks.ts";

/** Light of the sun and radiance of the sky along the arc; 1 is the brightest light of the day. */
export interface Sky {
  /** Haze of the air, 1 (clear) to 10. */
  readonly turbidity: number;
  /** Clock at t = 0, ½ and 1, hours; null where the arc is not that of a day. */
  readonly hours: Vec3 | null;
  /** Increasing times t from 0 to 1. */
  readonly times: readonly number[];
  /** Brightness at each time: fields are learned for light divided by it. */
  readonly level: readonly number[];
  /** Irradiance of the sun at normal incidence at each time, linear. */
  readonly sun: readonly Vec3[];
  /** Nine numbers of each colour at each time. */
  readonly model: readonly (readonly number[])[];
}

const MAX_TIMES = 64;
const COEFFICIENTS = 9;
/** Largest number of any kind: limits against hostile files. */
const MOST = 1e6;
/** No level is below this: light is divided by it. */
const LEAST_LEVEL = 1e-6;

/** Read `variable.sky`; null where there is none. */
export function readSky(value: unknown, where: string): Sky | null {
  if (value === undefined) return null;
  const entry = record(value, where);
  const times = list(entry.times, `${where}.times`, MAX_TIMES).map((t, i) => number(t, `${where}.times[${i}]`, 0, 1));
  const rising = times.every((t, i) => i === 0 || t > times[i - 1]!);
  if (times.length < 2 || !rising || times[0] !== 0 || times.at(-1) !== 1) fail(`${where}.times`, "increasing numbers from 0 to 1");
  const rows = (name: string) => {
    const found = list(entry[name], `${where}.${name}`, MAX_TIMES);
    return found.length === times.length ? found : fail(`${where}.${name}`, `as many as times, ${times.length}`);
  };
  return {
    turbidity: number(entry.turbidity, `${where}.turbidity`, 1, 10),
    hours: entry.hours === undefined ? null : readHours(entry.hours, `${where}.hours`),
    times,
    level: rows("level").map((v, i) => number(v, `${where}.level[${i}]`, LEAST_LEVEL, MOST)),
    sun: rows("sun").map((v, i) => vec3(v, `${where}.sun[${i}]`)),
    model: rows("model").map((v, i) => readModel(v, `${where}.model[${i}]`)),
  };
}

function readHours(value: unknown, where: string): Vec3 {
  const hours = vec3(value, where);
  return hours[0] < hours[1] && hours[1] < hours[2] ? hours : fail(where, "three increasing hours");
}

function readModel(value: unknown, where: string): number[] {
  const row = list(value, where, 3 * COEFFICIENTS);
  if (row.length !== 3 * COEFFICIENTS) fail(where, `${3 * COEFFICIENTS} numbers`);
  return row.map((v, i) => number(v, `${where}[${i}]`, -MOST, MOST));
}

/** Index of the time before t, and how far t is on the way to the next one. */
function between({ times }: Sky, t: number): readonly [number, number] {
  let k = 0;
  while (k < times.length - 2 && times[k + 1]! <= t) k++;
  const share = (t - times[k]!) / (times[k + 1]! - times[k]!);
  return [k, Math.min(1, Math.max(0, share))];
}

/** Brightness of the light at a time. */
export function levelAt(sky: Sky, t: number): number {
  const [k, share] = between(sky, t);
  return sky.level[k]! * (1 - share) + sky.level[k + 1]! * share;
}

/** Irradiance of the sun at normal incidence at a time, linear. */
export function sunlightAt(sky: Sky, t: number): [number, number, number] {
  const [k, share] = between(sky, t);
  const mix = (c: 0 | 1 | 2) => sky.sun[k]![c] * (1 - share) + sky.sun[k + 1]![c] * share;
  return [mix(0), mix(1), mix(2)];
}

/** Radiance of the sky in a direction, without the sun's disc. Args: time; unit directions to the sun and of the view, y is up. */
export function skyAt(sky: Sky, t: number, sun: Vec3, view: Vec3): [number, number, number] {
  if (view[1] < 0) return [0, 0, 0];
  const [k, share] = between(sky, t);
  const cosine = Math.min(1, Math.max(-1, sun[0] * view[0] + sun[1] * view[1] + sun[2] * view[2]));
  const at = (row: readonly number[], c: number) => formula(row, c * COEFFICIENTS, view[1], cosine);
  const mix = (c: number) => Math.max(0, at(sky.model[k]!, c) * (1 - share) + at(sky.model[k + 1]!, c) * share);
  return [mix(0), mix(1), mix(2)];
}

/** The formula of Hošek and Wilkie 2012. */
function formula(row: readonly number[], first: number, height: number, cosine: number): number {
  const [a, b, c, d, e, f, g, h, i] = row.slice(first, first + COEFFICIENTS) as [number, number, number, number, number, number, number, number, number];
  const squared = cosine * cosine;
  const glow = (1 + squared) / (1 + h * h - 2 * h * cosine) ** 1.5;
  const around = c + d * Math.exp(e * Math.acos(cosine)) + f * squared + g * glow + i * Math.sqrt(height);
  return (1 + a * Math.exp(b / (height + 0.01))) * around;
}

/** The clock at a time, hours; null where the arc is not that of a day. */
export function hourAt({ hours }: Sky, t: number): number | null {
  if (!hours) return null;
  const [first, middle, last] = hours;
  return t < 0.5 ? first + 2 * t * (middle - first) : middle + (2 * t - 1) * (last - middle);
}

/** The time t of a clock, `18:30` or hours; null where the sun is not up then, or there is no clock. */
export function timeOfHour({ hours }: Sky, hour: number): number | null {
  if (!hours) return null;
  const [first, middle, last] = hours;
  const found = [hour, hour - 24, hour + 24].find((h) => h >= first - 1e-6 && h <= last + 1e-6);
  if (found === undefined) return null;
  const t = found < middle ? (found - first) / (2 * (middle - first)) : 0.5 + (found - middle) / (2 * (last - middle));
  return Math.min(1, Math.max(0, t));
}

/** Hours as a clock shows them. */
export function clockText(hours: number): string {
  const minutes = ((Math.round(hours * 60) % 1440) + 1440) % 1440;
  return `${String(Math.floor(minutes / 60)).padStart(2, "0")}:${String(minutes % 60).padStart(2, "0")}`;
}

/** Hours of `18:30` or `18.5`; null where the text is neither. */
export function readClock(text: string): number | null {
  const match = /^(\d{1,2}):([0-5]\d)$/.exec(text.trim());
  const hours = match ? Number(match[1]) + Number(match[2]) / 60 : text.trim() === "" ? Number.NaN : Number(text);
  return hours >= 0 && hours <= 24 ? hours : null;
}
