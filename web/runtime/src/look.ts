/** How learned light is drawn, whatever the renderer. */

import type { SurfaceLook } from "./surface-materials.ts";

/** How the learned light is drawn. */
export interface Look {
  /** Evaluate it at half the width and height, and bring it back by a joint bilateral filter. */
  readonly half: boolean;
  /** Show which expert shades each point instead of any light; only where `hasSegments`. */
  readonly segments: boolean;
}

/** At full resolution. */
export const FULL: Look = { half: false, segments: false };

/** Outputs of a graph that the picture of segments shows; the first is required. */
export const SEGMENT_OUTPUTS: readonly string[] = ["segment", "overlap", "second"];

/** What is shown, one after the other, to draw a look. */
export function looksOf({ half, segments }: Look): readonly SurfaceLook[] {
  if (segments) return ["segments"];
  return half ? ["indirect", "upsampled"] : ["learned"];
}
