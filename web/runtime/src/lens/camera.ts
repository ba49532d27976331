/** From a camera and its depth buffer to blur in pixels. */

/** A thin lens in front of a sensor. Lengths are metres. */
export interface LensCamera {
  /** Distance of the plane in focus along the camera's axis. */
  readonly focus: number;
  /** Focal length over the aperture's diameter; infinity is a pinhole. */
  readonly fstop: number;
  readonly focal: number;
  /** Width of the sensor. */
  readonly sensor: number;
  /** Share of the frame's time during which the shutter is open; 0.5 is 180°. */
  readonly shutter: number;
  /** Metres per unit of the depth. */
  readonly sceneUnit: number;
}

/** A full-frame camera with a normal lens. */
export const DEFAULT_CAMERA: LensCamera = { focus: 2.5, fstop: 2.8, focal: 0.05, sensor: 0.036, shutter: 0.5, sceneUnit: 1 };

/**
 * What the numbers of a depth texture mean: distances along the axis (`linear`), or a depth buffer, by its camera's near and
 * far plane or by its projection matrix (column by column). `range` is that of normalised device coordinates: WebGPU's
 * [0, 1] or WebGL's [-1, 1], whose buffers hold (z + 1) / 2. A reversed buffer has 1 at the near plane.
 */
export type DepthMeaning =
  | { readonly kind: "linear" }
  | { readonly kind: "planes"; readonly near: number; readonly far: number; readonly reversed?: boolean; readonly orthographic?: boolean }
  | { readonly kind: "projection"; readonly matrix: ArrayLike<number>; readonly range?: "webgpu" | "webgl" };

/** Throws where no picture can form, in one line that says what to change. */
export function checkCamera(camera: LensCamera): void {
  const { focus, fstop, focal, sensor, shutter, sceneUnit } = camera;
  const bad = (text: string): never => {
    throw new RangeError(`lens: ${text}`);
  };
  for (const [name, value] of Object.entries(camera)) if (typeof value !== "number" || Number.isNaN(value)) bad(`${name} is ${value}; give a number`);
  if (!(focal > 0 && focal < Infinity)) bad(`focal length ${focal * 1e3} mm; give one above 0, for example 0.05 m`);
  if (!(focus > focal)) bad(`focus at ${focus} m is not beyond the focal length of ${focal * 1e3} mm; focus farther away`);
  if (!(fstop > 0)) bad(`f-number ${fstop}; give one above 0, for example 2.8`);
  if (!(sensor > 0 && sensor < Infinity && sceneUnit > 0 && sceneUnit < Infinity)) bad("sensor width and scene unit must be above 0");
  if (!(shutter >= 0 && shutter <= 16)) bad(`shutter ${shutter} of a frame; use 0 to 16, 0.5 is 180 degrees`);
}

/** Kc in pixels × scene units: s(z) = Kc (1/focus − 1/z), for pictures `width` px wide. */
export function strength({ focus, fstop, focal, sensor, sceneUnit }: LensCamera, width: number): number {
  const image = focus === Infinity ? focal : (focal * focus) / (focus - focal);
  return ((focal / fstop / 2) * image) / (sensor / width) / sceneUnit;
}

/** One over the focus distance, per scene unit. */
export const inverseFocus = ({ focus, sceneUnit }: LensCamera): number => sceneUnit / focus;

/** The sensor width that gives a horizontal field of view (radians) with a focal length at infinity. */
export const sensorOf = (fovX: number, focal: number): number => 2 * focal * Math.tan(fovX / 2);

/** (a, b, c, e) such that one over the distance along the axis is (a d + b) / (c d + e) of a texel d. */
export function inverseDepth(meaning: DepthMeaning): [number, number, number, number] {
  if (meaning.kind === "linear") return [0, 1, 1, 0];
  if (meaning.kind === "planes") {
    const { near, far, reversed = false, orthographic = false } = meaning;
    if (!(far > near && near > (orthographic ? -Infinity : 0))) throw new RangeError(`lens: planes at ${near} and ${far}; near must be above 0 and below far`);
    if (orthographic) return reversed ? [0, 1, near - far, far] : [0, 1, far - near, near];
    const [first, slope] = reversed ? [1 / far, 1 / near - 1 / far] : [1 / near, 1 / far - 1 / near];
    return [slope, first, 0, 1];
  }
  const { matrix, range = "webgpu" } = meaning;
  const [zz, zw, wz, ww] = [matrix[10], matrix[14], matrix[11], matrix[15]] as [number, number, number, number];
  if (matrix.length !== 16 || ![zz, zw, wz, ww].every(Number.isFinite)) throw new RangeError("lens: a projection matrix has 16 finite numbers");
  // d = (zz z + zw) / (wz z + ww) with z the view depth, which is negative in front of the camera.
  const [gain, shift] = range === "webgl" ? [2, -1] : [1, 0];
  return [-wz * gain, zz - wz * shift, -ww * gain, zw - ww * shift];
}
