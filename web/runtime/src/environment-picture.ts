/** Decodes the picture of an environment to linear radiance. */

import type { Texture } from "three";
import { fail } from "./checks.ts";
import type { EnvironmentPicture } from "./environment.ts";

/** Largest edge that is kept: a background needs no more, and a canvas of the decoder is as large as the picture. */
const MAX_EDGE = 2048;
/** Factors of two between the bytes 255 and 0. */
const STOPS = 14;
/** Value of each byte, which is a logarithm; 0 is black. */
const VALUES = Float32Array.from({ length: 256 }, (_, byte) => (byte > 0 ? 2 ** (STOPS * (byte / 255 - 1)) : 0));

/** The texels of a texture that a loader has decoded. Throws a `FormatError` when it cannot be read or is too large. */
export function environmentPicture(texture: Texture, where: string): EnvironmentPicture {
  const image = texture.image as (CanvasImageSource & { readonly width: number; readonly height: number }) | null;
  const { width = 0, height = 0 } = image ?? {};
  if ((texture as { isCompressedTexture?: boolean }).isCompressedTexture || !image || width < 1 || height < 1) fail(where, "a PNG, JPEG or WebP picture");
  if (Math.max(width, height) > MAX_EDGE) fail(where, `at most ${MAX_EDGE} texels along an edge, found ${width} × ${height}`);
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d", { colorSpace: "srgb", willReadFrequently: true })!;
  context.drawImage(image, 0, 0);
  const { data } = context.getImageData(0, 0, width, height);
  const texels = new Float32Array(3 * width * height);
  for (let i = 0; i < width * height; i++) for (let c = 0; c < 3; c++) texels[3 * i + c] = VALUES[data[4 * i + c]!]!;
  return { width, height, texels };
}
