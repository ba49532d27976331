/** The glTF loader extension of Babylon.js that reads learned light. */

import type { BaseTexture } from "@babylonjs/core/Materials/Textures/baseTexture.js";
import type { AbstractMesh } from "@babylonjs/core/Meshes/abstractMesh.js";
import type { GLTFLoader } from "@babylonjs/loaders/glTF/2.0/glTFLoader.js";
import type { IGLTFLoaderExtension } from "@babylonjs/loaders/glTF/2.0/glTFLoaderExtension.js";
import { registerGLTFExtension, unregisterGLTFExtension } from "@babylonjs/loaders/glTF/2.0/glTFLoaderExtensionRegistry.js";
import type { IScene, ITexture } from "@babylonjs/loaders/glTF/2.0/glTFLoaderInterfaces.js";
import { FormatError } from "../checks.ts";
import { checkContainer, type GltfJson } from "../container.ts";
import { EXTENSION } from "../extension-name.ts";
import { readExtension, type Sources } from "../extension.ts";
import { BUDGET } from "../graph/budget.ts";
import { type BabylonLightOptions, LearnedLight } from "./babylon-light.ts";

const LIGHTS = new WeakMap<AbstractMesh, LearnedLight>();

/** The learned light of a loaded file by its root (`meshes[0]` of `ImportMeshAsync`); null when it carries none. */
export function learnedLight(root: AbstractMesh): LearnedLight | null {
  return LIGHTS.get(root) ?? null;
}

/** Let Babylon.js' glTF loader show learned light from now on; once for a page. */
export function registerLearnedLight(options: BabylonLightOptions = {}): void {
  unregisterGLTFExtension(EXTENSION);
  registerGLTFExtension(EXTENSION, true, (loader) => new LearnedLightExtension(loader, options));
}

class LearnedLightExtension implements IGLTFLoaderExtension {
  readonly name = EXTENSION;
  enabled = true;
  readonly order = 1000;
  private readonly loader: GLTFLoader;
  private readonly options: BabylonLightOptions;

  constructor(loader: GLTFLoader, options: BabylonLightOptions) {
    this.loader = loader;
    this.options = options;
  }

  dispose(): void {}

  /** Loads the scene, then lights it. */
  loadSceneAsync(context: string, scene: IScene): Promise<void> {
    const { loader } = this;
    const json = loader.gltf as unknown as GltfJson;
    checkContainer(json);
    return Promise.all([readExtension(json, this.sources(), BUDGET), loader.loadSceneAsync(context, scene)]).then(([radiance]) => {
      const root = loader.rootBabylonMesh as AbstractMesh | null;
      if (!radiance) return;
      if (!root) throw new Error("lightwell/babylon: expected a root node of the file; load it without customRootNode: null");
      const light = new LearnedLight(radiance, root, loader.babylonScene, this.options);
      LIGHTS.set(root, light);
      root.onDisposeObservable.addOnce(() => light.dispose());
    });
  }

  private sources(): Sources {
    const { loader } = this;
    return {
      async bufferView(index) {
        const view = await loader.loadBufferViewAsync(`/bufferViews/${index}`, loader.gltf.bufferViews![index]!);
        // Numbers are read from the start of a buffer of their own.
        return new Uint8Array(view.buffer, view.byteOffset, view.byteLength).slice().buffer;
      },
      async texture(index) {
        const entry = loader.gltf.textures![index]! as ITexture & { gammaSpace?: boolean };
        // Babylon.js fetches its decoder from another site, and what it decodes was never compared with ours.
        if (entry.extensions?.KHR_texture_basisu)
          throw new FormatError(`textures[${index}]: expected PNG or WebP, found KTX2; bake without --compress, or show it with three.js`);
        const texture: BaseTexture = await loader.loadTextureInfoAsync(`/textures/${index}`, { index });
        texture.gammaSpace = false;
        await ready(texture);
        const { width, height } = texture.getSize();
        return { source: texture, width, height, bytes: entry.source === undefined ? 0 : 1 };
      },
    };
  }
}

/** Resolves when a texture has its picture. */
function ready(texture: BaseTexture): Promise<void> {
  return new Promise((resolve) => {
    const look = () => (texture.isReady() ? resolve() : setTimeout(look, 5));
    look();
  });
}
