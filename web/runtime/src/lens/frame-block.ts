/** The uniform block of a frame: camera, depth and choices as the shaders read them. */

import { checkCamera, DEFAULT_CAMERA, type DepthMeaning, inverseDepth, inverseFocus, type LensCamera, strength } from "./camera.ts";
import type { Plan } from "./plan.ts";
import { FLAGS, FRAME_BYTES } from "./wgsl-frame.ts";

/** How light from outside the picture is guessed: its border repeated, dividing by coverage, or not at all. */
export type Edges = "extend" | "renormalise" | "dark";

/** What a frame is, textures aside; as in `LensFrame` and `LensOptions`. */
export interface FrameFacts {
  readonly depthMeaning: DepthMeaning;
  /** Whether there is a motion texture that is used. */
  readonly motion: boolean;
  readonly motionScale?: readonly [number, number];
  readonly camera?: Partial<LensCamera>;
  readonly opaque?: boolean;
  readonly white?: number;
  readonly cut?: number | null;
  readonly number?: number;
  readonly edges: Edges;
  readonly tolerance: number;
}

/** Throws unless a value is a number above 0. */
export function positive(value: number, what: string): number {
  if (!(value > 0 && value < Infinity)) throw new RangeError(`lens: ${what} is ${value}; give a number above 0`);
  return value;
}

/** The block for a plan and a frame. */
export function frameBlock({ options, domain, guard, extend }: Plan, frame: FrameFacts): ArrayBuffer {
  const camera: LensCamera = { ...DEFAULT_CAMERA, ...frame.camera };
  checkCamera(camera);
  const { opaque = true, white = 1, cut = null, number = 0, motionScale = [1, 1], edges, tolerance } = frame;
  positive(white, "white");
  const flags =
    (cut === null ? FLAGS.autoCut : 0) |
    (frame.motion ? FLAGS.motion : 0) |
    (opaque ? FLAGS.opaque : 0) |
    (opaque && edges !== "dark" ? FLAGS.normalise : 0);
  const block = new ArrayBuffer(FRAME_BYTES);
  new Uint32Array(block).set([options.width, options.height, ...domain, guard, extend, (16 * number) >>> 0, flags]);
  new Float32Array(block).set(
    [
      ...inverseDepth(frame.depthMeaning),
      ...[strength(camera, options.width), inverseFocus(camera), options.largest, options.longest],
      ...[motionScale[0] * camera.shutter, motionScale[1] * camera.shutter, white, tolerance],
      cut ?? 0,
    ],
    8,
  );
  return block;
}
