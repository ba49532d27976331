/** What draws: the name of the rasteriser, and what follows from it. */

import type { WebGLRenderer } from "three";

/** Rasterisers on the CPU. */
const SOFTWARE = /swiftshader|llvmpipe|lavapipe|softpipe|software|basic render/i;

/** Up to this many multiply-adds a pixel, weights become literals of the shader: on a GPU, and on a CPU. */
const INLINE_LIMIT = 4096;
const INLINE_LIMIT_SOFTWARE = 16384;

/** Name that the driver gives itself. */
export function rendererName(gl: WebGLRenderingContext | WebGL2RenderingContext): string {
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  return String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER) ?? "");
}

/** Whether a rasteriser of this name runs on the CPU. */
export function isSoftware(name: string): boolean {
  return SOFTWARE.test(name);
}

/**
 * Largest field, in multiply-adds a pixel, whose weights are best literals of the shader. Fetching them from a texture
 * costs a CPU 2.5 to 13 times as much; on a GPU long texts compile slowly for little gain.
 */
export function inlineLimit(renderer: WebGLRenderer | undefined): number {
  const software = renderer !== undefined && isSoftware(rendererName(renderer.getContext()));
  return software ? INLINE_LIMIT_SOFTWARE : INLINE_LIMIT;
}
