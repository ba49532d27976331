/** Reads untrusted JSON: every function returns the value in its type or throws a `FormatError` that names the place. */

/** An asset that breaks the contract of `format/FORMAT.md`: the only error that a file causes. */
export class FormatError extends Error {
  override readonly name = "FormatError";
}

/** Throws a `FormatError`: where, and what was expected there. */
export function fail(where: string, expected: string): never {
  throw new FormatError(`${where}: expected ${expected}`);
}

/** A JSON object. */
export function record(value: unknown, where: string): Record<string, unknown> {
  if (typeof value !== "object" || value === null || Array.isArray(value)) fail(where, "an object");
  return value as Record<string, unknown>;
}

/** An array of at most `limit` entries. */
export function list(value: unknown, where: string, limit: number): unknown[] {
  if (!Array.isArray(value)) fail(where, "an array");
  if (value.length > limit) fail(where, `at most ${limit} entries, found ${value.length}`);
  return value;
}

/** A string of at most 256 characters. */
export function text(value: unknown, where: string): string {
  if (typeof value !== "string" || value.length > 256) fail(where, "a string of at most 256 characters");
  return value;
}

/** A finite number in [low, high]. */
export function number(value: unknown, where: string, low = -Infinity, high = Infinity): number {
  if (typeof value !== "number" || !Number.isFinite(value) || value < low || value > high) {
    fail(
      where,
      Number.isFinite(low) || Number.isFinite(high) ? `a number in [${low}, ${high}]` : "a finite number",
    );
  }
  return value;
}

/** An integer in [low, high]. */
export function integer(value: unknown, where: string, low: number, high: number): number {
  if (!Number.isInteger(number(value, where, low, high))) fail(where, "an integer");
  return value as number;
}

/** Three numbers. */
export type Vec3 = readonly [number, number, number];

/** Three finite numbers. */
export function vec3(value: unknown, where: string): Vec3 {
  const entries = list(value, where, 3);
  if (entries.length !== 3) fail(where, "three numbers");
  return entries.map((x, i) => number(x, `${where}[${i}]`)) as unknown as Vec3;
}

/** A direction: three finite numbers, returned with length one. */
export function direction(value: unknown, where: string): Vec3 {
  const v = vec3(value, where);
  const length = Math.hypot(...v);
  if (!(length > 1e-6)) fail(where, "a direction that is not zero");
  return [v[0] / length, v[1] / length, v[2] / length];
}
