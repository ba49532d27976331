/** three.js' `WebGPURenderer` for a device that is there already. */

import { Renderer, StandardNodeLibrary, WebGPUBackend, type WebGPURendererParameters } from "three/webgpu";

/** As `WebGPURenderer`, without its other backend: to fall back to WebGL 2 takes 95 kB of code that the page never needs. */
export class DeviceRenderer extends Renderer {
  readonly isWebGPURenderer = true;

  constructor(parameters: WebGPURendererParameters & { readonly canvas: HTMLCanvasElement; readonly device: GPUDevice }) {
    super(new WebGPUBackend(parameters), parameters);
    this.library = new StandardNodeLibrary();
  }

  /**
   * End a frame. three.js counts frames by an animation loop that every call of `render` starts; shadow maps are drawn once a
   * frame. Without the loop the next call begins another frame, and a page that rests does nothing.
   */
  endFrame(): void {
    (this as unknown as { _animation: { stop(): void } })._animation.stop();
  }
}
