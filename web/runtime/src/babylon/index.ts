/** `lightwell/babylon`: learned light in Babylon.js. */

export { FormatError } from "../checks.ts";
export type { EngineParts } from "../engines/engine-light.ts";
export { type BabylonLightOptions, LearnedLight } from "./babylon-light.ts";
export { BabylonLamp } from "./babylon-lamp.ts";
export { LearnedLightPlugin } from "./light-plugin.ts";
export { learnedLight, registerLearnedLight } from "./loader-extension.ts";
