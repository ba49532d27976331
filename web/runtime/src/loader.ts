/** three.js GLTFLoader plugin that reads the learned light of a glTF file. */

import type { GLTF, GLTFLoaderPlugin, GLTFParser } from "three/addons/loaders/GLTFLoader.js";
import { checkContainer, type GltfJson } from "./container.ts";
import { EXTENSION, type NeuralRadiance, readExtension } from "./extension.ts";

/**
 * Puts the checked extension on `gltf.userData.lightwell`.
 *
 * ```ts
 * const loader = new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser));
 * const gltf = await loader.loadAsync("scene.glb");
 * const scene = new LearnedScene(gltf);
 * ```
 */
export class LightwellLoaderPlugin implements GLTFLoaderPlugin {
  readonly name = EXTENSION;
  private readonly parser: GLTFParser;

  constructor(parser: GLTFParser) {
    this.parser = parser;
  }

  /** Rejects a document that a loader could not read safely, before anything of it is loaded. */
  async beforeRoot(): Promise<void> {
    checkContainer(this.parser.json as GltfJson);
  }

  async afterRoot(gltf: GLTF): Promise<void> {
    const loadView = (index: number) =>
      this.parser.getDependency("bufferView", index) as Promise<ArrayBuffer>;
    const radiance = await readExtension(this.parser.json as GltfJson, loadView);
    if (radiance) gltf.userData.lightwell = radiance;
  }
}

/** The learned light that `LightwellLoaderPlugin` found in a file; an empty one when there is none. */
export function learnedLight(gltf: GLTF): NeuralRadiance {
  return (gltf.userData.lightwell as NeuralRadiance | undefined) ?? { variables: [], fields: [] };
}
