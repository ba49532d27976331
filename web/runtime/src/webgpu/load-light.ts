/** Learned light for a model that was loaded elsewhere, for `WebGPURenderer`. */

import type { Object3D } from "three";
import { fileLight } from "../file-light.ts";
import type { LoaderOptions } from "../loader.ts";
import { LearnedNodeScene, type LearnedNodeSceneOptions } from "./learned-node-scene.ts";

/** As `loadLight` of `lightwell`, with a `LearnedNodeScene`. */
export async function loadLight(source: string | ArrayBuffer, model: Object3D, options: LoaderOptions & LearnedNodeSceneOptions = {}): Promise<LearnedNodeScene> {
  return new LearnedNodeScene(await fileLight(source, model, options), options);
}
