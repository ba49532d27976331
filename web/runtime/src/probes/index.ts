/** `lightwell/probes`: probe volumes that light what moves, for three.js' `WebGLRenderer`; see also `lightwell/probes/webgpu`. */

export { type ProbeFile, readProbes } from "./file.ts";
export { probesGlsl, probesWgsl } from "./shader.ts";
export { type ProbeUse, ProbeVolume } from "./volume.ts";
