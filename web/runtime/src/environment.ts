/** What surrounds a scene and stands still: the radiance that is seen where no surface is. */

import { integer, list, number, record, type Vec3, vec3 } from "./checks.ts";
import type { LampSwitch } from "./switches.ts";

/** `environment` of the extension. */
export interface EnvironmentRecord {
  /** Linear; a factor of the picture where there is one. */
  readonly radiance: Vec3;
  /** Index of the texture; null where all directions are alike. */
  readonly texture: number | null;
  /** Index of the lamp that it follows; null where it cannot be changed. */
  readonly lamp: number | null;
}

/** Radiance of all directions: linear RGB, first row +Y, columns by atan2(z, x) from -π to π. */
export interface EnvironmentPicture {
  readonly width: number;
  readonly height: number;
  readonly texels: Float32Array;
}

/** What surrounds a loaded scene. */
export interface Environment {
  /** Linear; a factor of the picture where there is one. */
  readonly radiance: Vec3;
  readonly picture: EnvironmentPicture | null;
  /** The switch that it follows; null where it cannot be changed. */
  readonly lamp: LampSwitch | null;
}

const MOST_RADIANCE = 1e12;
const MAX_TEXTURES = 1 << 26;

/** Read `environment` of the extension; null where there is none. Args: the value; its place; the document's textures; number of lamps. */
export function readEnvironment(value: unknown, where: string, textures: unknown, lamps: number): EnvironmentRecord | null {
  if (value === undefined) return null;
  const entry = record(value, where);
  const radiance = vec3(entry.radiance, `${where}.radiance`);
  radiance.forEach((x, i) => number(x, `${where}.radiance[${i}]`, 0, MOST_RADIANCE));
  const index = (name: "texture" | "lamp", count: number) => (entry[name] === undefined ? null : integer(entry[name], `${where}.${name}`, 0, count - 1));
  return { radiance, texture: index("texture", list(textures ?? [], "textures", MAX_TEXTURES).length), lamp: index("lamp", lamps) };
}
