/** What the device behind a `WebGPURenderer` offers to shaders. */

import type { Capabilities } from "../material-budget.ts";

/** What every WebGPU device offers (WebGPU, *Limits*), and what three.js asks for unless it is told otherwise. */
const GUARANTEED = { maxSampledTexturesPerShaderStage: 16, maxSamplersPerShaderStage: 16, maxUniformBufferBindingSize: 65_536 };
/** Bytes of a vector in a uniform buffer. */
const VECTOR_BYTES = 16;

/** The part of a `WebGPURenderer` that says what it draws with; `backend` has neither before `init`. */
export interface DeviceOwner {
  readonly backend: object;
}

/** Whether shaders are written in WGSL: a renderer that fell back to WebGL 2 takes GLSL. */
export function takesWgsl(renderer: DeviceOwner | undefined): boolean {
  return (renderer?.backend as { isWebGPUBackend?: boolean } | undefined)?.isWebGPUBackend ?? true;
}

/** What a fragment shader may read on the renderer's device; without one, what every device offers. */
export function capabilitiesOf(renderer: DeviceOwner | undefined): Capabilities {
  const { device, gl } = (renderer?.backend ?? {}) as { device?: GPUDevice | null; gl?: WebGL2RenderingContext | null };
  if (gl) {
    const [maxTextures, block] = [gl.MAX_TEXTURE_IMAGE_UNITS, gl.MAX_UNIFORM_BLOCK_SIZE].map((name) => Number(gl.getParameter(name)));
    return { maxTextures: maxTextures!, maxFragmentUniforms: block! / VECTOR_BYTES };
  }
  const { maxSampledTexturesPerShaderStage, maxSamplersPerShaderStage, maxUniformBufferBindingSize } = device?.limits ?? GUARANTEED;
  return {
    maxTextures: Math.min(maxSampledTexturesPerShaderStage, maxSamplersPerShaderStage),
    maxFragmentUniforms: maxUniformBufferBindingSize / VECTOR_BYTES,
  };
}
