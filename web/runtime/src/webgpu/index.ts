/**
 * `lightwell/webgpu`: learned light for three.js' `WebGPURenderer`. It needs nothing of `lightwell` itself, so that a page may
 * map `three` to `three.webgpu.js`.
 */

export { LightwellLoaderPlugin, learnedLight } from "../loader.ts";
export type { DeviceOwner } from "./device.ts";
export { FieldNodes } from "./field-nodes.ts";
export { LearnedNodeScene, type LearnedNodeSceneOptions } from "./learned-node-scene.ts";
