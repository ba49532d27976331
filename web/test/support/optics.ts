/** Closed forms that the pictures of the tests are held against. */

type Point = readonly [number, number, number];

const minus = (a: Point, b: Point): Point => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a: Point, b: Point): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Where the eye of the fixtures' camera (at [0, 1, 4.2], looking along −z) meets z = `plane` through a pixel centre. */
export function backWallPoint(x: number, y: number, width: number, height: number, plane: number): Point {
  const half = Math.tan((36 * Math.PI) / 360);
  const depth = 4.2 - plane;
  const u = (((x + 0.5) / width) * 2 - 1) * half * (width / height);
  const v = (1 - ((y + 0.5) / height) * 2) * half;
  return [u * depth, 1 + v * depth, plane];
}

/** Radiance of a Lambertian surface under a point light: albedo/π · I · cos θ / d². */
export function lambert(
  albedo: number,
  intensity: number,
  light: Point,
  point: Point,
  normal: Point,
): number {
  const toLight = minus(light, point);
  const squared = dot(toLight, toLight);
  return ((albedo / Math.PI) * intensity * Math.max(0, dot(toLight, normal))) / squared ** 1.5;
}

/** sRGB encoding, 0 … 255. */
export function srgb255(linear: number): number {
  const x = Math.min(1, Math.max(0, linear));
  return 255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);
}
