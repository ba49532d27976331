/** What transmissive materials show where nothing is behind them. */

import type { WebGLRenderer } from "three";

// What three.js fills the picture behind glass with, where the canvas is not opaque.
const FILL = 0xffffff;
const FILL_ALPHA = 0.5;

/**
 * Show nothing behind glass where nothing is. three.js shows white there unless the clear colour is opaque, so that
 * the windows of a house at night would be white.
 */
export function clearBehindGlass(renderer: WebGLRenderer): void {
  const set = renderer.setClearColor.bind(renderer);
  renderer.setClearColor = (color, alpha) => {
    if (color === FILL && alpha === FILL_ALPHA) set(0, 0);
    else set(color, alpha);
  };
}
