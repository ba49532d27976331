/** The three.js renderer, and what its shader compiler says. */

import { PCFShadowMap, WebGLRenderer } from "three";
import { clearBehindGlass } from "lightwell";

/** A renderer with shadow maps; what is not covered stays transparent. */
export function createRenderer(canvas: HTMLCanvasElement): WebGLRenderer {
  const renderer = new WebGLRenderer({ canvas, antialias: false, powerPreference: "high-performance" });
  renderer.setClearColor(0, 0);
  clearBehindGlass(renderer);
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = PCFShadowMap;
  return renderer;
}

/** Tell `listener` when the graphics context is lost, and when it is back. */
export function onContextLoss(canvas: HTMLCanvasElement, listener: (lost: boolean) => void): void {
  canvas.addEventListener("webglcontextlost", (event) => {
    event.preventDefault();
    listener(true);
  });
  canvas.addEventListener("webglcontextrestored", () => listener(false));
}

/** Hand the log of every shader that does not compile to `listener`. */
export function onShaderError(renderer: WebGLRenderer, listener: (log: string) => void): void {
  renderer.debug.onShaderError = (gl, program, vertex, fragment) => {
    const logs = [gl.getShaderInfoLog(vertex), gl.getShaderInfoLog(fragment), gl.getProgramInfoLog(program as unknown as WebGLProgram)];
    listener(logs.filter(Boolean).join("\n") || "no log");
  };
}

/** Resolves when what was drawn has been handed to the screen; soon, when the page is not shown at all. */
export function seen(): Promise<void> {
  return new Promise((resolve) => {
    requestAnimationFrame(() => setTimeout(resolve));
    setTimeout(resolve, 100);
  });
}
