/** Learned light for a model that was loaded elsewhere, for `WebGLRenderer`. */

import type { Object3D } from "three";
import { fileLight } from "./file-light.ts";
import { LearnedScene, type LearnedSceneOptions } from "./learned-scene.ts";
import type { LoaderOptions } from "./loader.ts";

/**
 * Light a model with the learned light of a baked file; of the file's own model nothing is loaded.
 *
 * Args: the address of a baked GLB, or its bytes; the model, which must stand in its own space as the baked one does in the file (its
 * materials' second texture coordinates too, for a neural light map); options of `LightwellLoaderPlugin` and of `LearnedScene`. Returns
 * the scene, whose `root` is the model. Rejects with a `FormatError` when the file has no learned light or is not as `format/FORMAT.md`
 * says, and with an `Error` when it cannot be fetched.
 */
export async function loadLight(source: string | ArrayBuffer, model: Object3D, options: LoaderOptions & LearnedSceneOptions = {}): Promise<LearnedScene> {
  return new LearnedScene(await fileLight(source, model, options), options);
}
