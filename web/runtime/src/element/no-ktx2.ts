/** Stands in for three.js' decoder of KTX2 textures in builds of one file, which would be twice as large with it. */

/** Refuses. */
export class KTX2Loader {
  detectSupport(): never {
    throw new Error("The file has KTX2 textures, which this build does not decode: import lightwell from npm, or convert them to WebP (gltf-transform webp).");
  }
}
