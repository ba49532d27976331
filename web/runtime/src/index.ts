export { filterAnisotropically } from "./anisotropy.ts";
export { clearBehindGlass } from "./behind-glass.ts";
export { Arc } from "./arc.ts";
export { FormatError, type Vec3 } from "./checks.ts";
export { checkContainer, checkSelfContained, readContainer } from "./container.ts";
export { inlineLimit, isSoftware, rendererName } from "./device.ts";
export {
  type FieldRecord,
  FORMAT_VERSION,
  type NeuralRadiance,
  readExtension,
} from "./extension.ts";
export { FieldProgram } from "./field-program.ts";
export { BUDGET, type Budget, type Graph, type GraphNode, type StoredBuffer } from "./graph/index.ts";
export type { LampAnimation, PlayOptions } from "./lamp-clips.ts";
export { createLamp, type Lamp, PointLamp, SunLamp, sunsWithSky } from "./lamp.ts";
export { LearnedField, type WeightPlacement } from "./learned-field.ts";
export { LearnedScene, type LearnedSceneOptions } from "./learned-scene.ts";
export type { Look } from "./look.ts";
export type { Environment, EnvironmentPicture, EnvironmentRecord } from "./environment.ts";
export { clippingPlanes } from "./core.ts";
export type { CoreRecord } from "./core-record.ts";
export { EXTENSION } from "./extension-name.ts";
export { type Lightmap, type LoadedLight, learnedLight } from "./loaded-light.ts";
export { loadLight } from "./load-light.ts";
export { type LoaderOptions, LightwellLoaderPlugin, parseLearned } from "./loader.ts";
export type { DisposeOptions, Parts, SceneOptions } from "./scene-core.ts";
export { SEGMENT_COLORS } from "./segment-colors.ts";
export type { ClipRecord, MoverRecord, NodeRecord } from "./mover-record.ts";
export { moverValuesText, readMoverValues } from "./mover-values.ts";
export type { Mover } from "./movers.ts";
export { type LampRecord, type LampSetting, lampSettingsText, LampSwitch, MAX_SWITCHES, readLampSettings } from "./switches.ts";
export { clockText, hourAt, readClock, type Sky, skyAt } from "./sky.ts";
export { SkyBackground } from "./sky-background.ts";
export { angleInRange, angleOf, northAt, type TurningVariable } from "./turning.ts";
export type { TurningLamp } from "./turning-lamp.ts";
export { turningOf } from "./turning-of.ts";
export { MAX_LAMPS } from "./most.ts";
export type { PointVariable, SunVariable, Variable } from "./variables.ts";
