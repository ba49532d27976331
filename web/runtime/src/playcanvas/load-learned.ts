/** Loads a file with learned light into PlayCanvas. */

import { type AppBase, Asset } from "playcanvas";
import { FormatError } from "../checks.ts";
import { checkContainer, checkSelfContained, readContainer } from "../container.ts";
import { readExtension } from "../extension.ts";
import { NO_LIGHT } from "../no-light.ts";
import { LearnedLight, type LearnedLightOptions } from "./learned-light.ts";

/** Files so far. */
let files = 0;

/**
 * Load a GLB with learned light.
 *
 * Args: the application, on a WebGL 2 device; the file's address, or its bytes. Returns the light, whose `root` hangs nowhere yet.
 * Rejects with a `FormatError` when the file is not as `format/FORMAT.md` says, and with an `Error` when PlayCanvas cannot load it.
 */
export async function loadLearned(app: AppBase, source: string | ArrayBuffer, options: LearnedLightOptions = {}): Promise<LearnedLight> {
  if (!app.graphicsDevice.isWebGL2) throw new Error("lightwell/playcanvas: expected a WebGL 2 device, found another; create the application with deviceTypes: ['webgl2']");
  const bytes = typeof source === "string" ? await download(source) : source;
  const { json, binary } = readContainer(new Uint8Array(bytes));
  checkSelfContained(json);
  checkContainer(json, binary);
  const views = (json.bufferViews ?? []) as { byteOffset?: number; byteLength: number }[];
  const radiance = await readExtension(json, {
    async bufferView(index) {
      const { byteOffset = 0, byteLength } = views[index]!;
      return binary!.slice(byteOffset, byteOffset + byteLength).buffer as ArrayBuffer;
    },
    async texture() {
      throw new FormatError("lightwell/playcanvas: expected a field without pictures, found a neural light map; show it with three.js or Babylon.js");
    },
  });
  const name = typeof source === "string" ? source : "scene.glb";
  // PlayCanvas shares what has one address and one hash, materials too: each light needs its own.
  const asset = new Asset(name, "container", { url: name, filename: "scene.glb", contents: bytes, hash: `lightwell${files++}` } as never);
  await new Promise<void>((resolve, reject) => {
    asset.once("load", () => resolve());
    asset.once("error", (message: string) => reject(new Error(`lightwell/playcanvas: ${name}: ${message}`)));
    app.assets.add(asset);
    app.assets.load(asset);
  });
  try {
    return new LearnedLight(app, asset, radiance ?? NO_LIGHT, options);
  } catch (error) {
    app.assets.remove(asset);
    asset.unload();
    throw error;
  }
}

async function download(url: string): Promise<ArrayBuffer> {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`lightwell/playcanvas: ${url}: expected a file, found status ${response.status}`);
  return response.arrayBuffer();
}
