/** `lightwell/lens`: depth of field and motion blur as a WebGPU compute effect, by Laplacian kernel splatting. It needs no three.js. */

export { DEFAULT_CAMERA, type DepthMeaning, type LensCamera, sensorOf } from "./camera.ts";
export { type Edges, type FrameFacts, frameBlock } from "./frame-block.ts";
export { Lens, type LensFrame, type LensOptions, type LensReport } from "./lens.ts";
export { LibraryError, readLibrary, type SpreadletFamily, type SpreadletLibrary, type SpreadletRecord } from "./library.ts";
export { type Plan, plan, type PlanOptions, type PlannedBuffer, type PlannedShader, type Step } from "./plan.ts";
export type { PictureFormat } from "./wgsl-composite.ts";
