/**
 * `lightwell/webgpu`: learned light for three.js' `WebGPURenderer`. It needs nothing of `lightwell` itself, so that a page may
 * map `three` to `three.webgpu.js`.
 */

export type { WeightPlacement } from "../learned-field.ts";
export type { LampAnimation, PlayOptions } from "../lamp-clips.ts";
export { learnedLight } from "../loaded-light.ts";
export { LightwellLoaderPlugin } from "../loader.ts";
export type { DisposeOptions, Parts } from "../scene-core.ts";
export type { DeviceOwner } from "./device.ts";
export { FieldNodes } from "./field-nodes.ts";
export type { Look } from "../look.ts";
export { LearnedNodeScene, type LearnedNodeSceneOptions, type NodeRenderer } from "./learned-node-scene.ts";
export { loadLight } from "./load-light.ts";
export { learnedRadiance, type RadianceInputs } from "./learned-radiance.ts";
