/** `lightwell/webgpu`: learned light for three.js' `WebGPURenderer`. */

export { FieldNodes } from "./field-nodes.ts";
export { LearnedNodeScene, type LearnedNodeSceneOptions } from "./learned-node-scene.ts";
