/** Reads the glTF material extension `MOZ_lightmap`: an ordinary light map of linear irradiance. */

import type { Texture } from "three";
import { integer, number, record } from "./checks.ts";

/** Name of the extension. */
export const LIGHTMAP_EXTENSION = "MOZ_lightmap";

/** three.js hands four sets of texture coordinates to its shaders. */
const MAX_TEX_COORD = 3;
const MAX_INTENSITY = 1e6;

/** Irradiance of a diffuse surface is `intensity` times the texel; its radiance, albedo / π times that. */
export interface LightmapRecord {
  /** Index of the texture. */
  readonly index: number;
  readonly texCoord: number;
  readonly intensity: number;
}

/** An ordinary light map of a material, as a texture. */
export interface Lightmap extends LightmapRecord {
  readonly map: Texture;
  /** Size of the encoded picture; 0 when unknown. */
  readonly bytes: number;
}

/** The light map among a material's extensions, of a document with so many textures; null when there is none. */
export function readLightmap(extensions: unknown, textures: number, where: string): LightmapRecord | null {
  const found = (extensions as Record<string, unknown> | undefined)?.[LIGHTMAP_EXTENSION];
  if (found === undefined) return null;
  const entry = record(found, where);
  return {
    index: integer(entry.index, `${where}.index`, 0, textures - 1),
    texCoord: integer(entry.texCoord ?? 1, `${where}.texCoord`, 0, MAX_TEX_COORD),
    intensity: number(entry.intensity ?? 1, `${where}.intensity`, 0, MAX_INTENSITY),
  };
}
