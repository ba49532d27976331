/** What the loader plugin leaves on a loaded file. */

import type { Material, Object3D } from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import type { EnvironmentPicture } from "./environment.ts";
import type { NeuralRadiance } from "./extension.ts";
import type { LampPlayer } from "./lamp-clips.ts";
import type { Lightmap } from "./lightmap.ts";
import type { Mover } from "./movers.ts";
import { NO_LIGHT } from "./no-light.ts";
import type { LampSwitch } from "./switches.ts";
import type { TurningVariable } from "./turning.ts";
import type { TurningLamp } from "./turning-lamp.ts";

export type { Lightmap };

/** What the plugin leaves on `gltf.userData.lightwell`. */
export interface LoadedLight extends NeuralRadiance {
  /** Ordinary light maps (MOZ_lightmap), which the learned light takes the place of. */
  readonly lightmaps: ReadonlyMap<Material, Lightmap>;
  /** Makes what moves the nodes of `movers`, in their order; null where the file has none. Adds the light maps of materials that it copies. */
  readonly moving: ((root: Object3D, lightmaps: Map<Material, Lightmap>) => Mover[]) | null;
  /** Makes what plays animations of `lamps`; null where the file has none. */
  readonly playing: ((switches: readonly LampSwitch[]) => LampPlayer) | null;
  /** Makes the lamp of the environment that turns; null where none does. */
  readonly turning: ((variable: TurningVariable, root: Object3D) => TurningLamp) | null;
  /** The picture of `environment`; null where it has none. */
  readonly surrounding: EnvironmentPicture | null;
}

/** The learned light that `LightwellLoaderPlugin` found in a file; an empty one when there is none. */
export function learnedLight(gltf: GLTF): LoadedLight {
  const found = gltf.userData.lightwell as LoadedLight | undefined;
  return found ?? { ...NO_LIGHT, moving: null, playing: null, turning: null, surrounding: null, lightmaps: new Map() };
}
