/** `lightwell/playcanvas`: learned light in PlayCanvas. */

export { FormatError } from "../checks.ts";
export type { EngineParts } from "../engines/engine-light.ts";
export { LearnedLight, type LearnedLightOptions, type PlayCanvasLamp } from "./learned-light.ts";
export { loadLearned } from "./load-learned.ts";
export { LightwellScene } from "./script.ts";
