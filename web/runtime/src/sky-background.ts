/** The sky behind a scene: what surrounds it and stands still, and that of its suns, drawn from their numbers. */

import { ClampToEdgeWrapping, DataTexture, DataUtils, EquirectangularReflectionMapping, HalfFloatType, LinearFilter, RepeatWrapping, RGBAFormat } from "three";
import type { Environment } from "./environment.ts";
import { type Lamp, type SunLamp, sunsWithSky } from "./lamp.ts";
import { skyAt } from "./sky.ts";
import type { TurningLamp } from "./turning-lamp.ts";
import { turningOf } from "./turning-of.ts";

/** Columns and rows of the picture: rows of 0.7 degrees, so that the horizon is a line. That of an environment has its own. */
const WIDTH = 128;
const HEIGHT = 256;
/** Steps from the horizon to the zenith at which the sky is evaluated: 2.8 degrees, finer than the glow about the sun. */
const STEPS = 32;
/** Largest value of the picture: half floats end at 65,504. */
const MOST = 65_000;

/** A picture for `scene.background`; the root of the scene must not be turned. */
export class SkyBackground {
  readonly texture: DataTexture;
  private readonly environment: Environment | null;
  private drawn = "";

  /** Args: what surrounds the scene, `learned.environment`; null for its suns alone. */
  constructor(environment: Environment | null = null) {
    this.environment = environment;
    const { width, height } = environment?.picture ?? { width: WIDTH, height: HEIGHT };
    this.texture = new DataTexture(new Uint16Array(4 * width * height), width, height, RGBAFormat, HalfFloatType);
    this.texture.mapping = EquirectangularReflectionMapping;
    this.texture.minFilter = this.texture.magFilter = LinearFilter;
    this.texture.wrapS = RepeatWrapping;
    this.texture.wrapT = ClampToEdgeWrapping;
  }

  /** Bring the picture up to date; call before drawing. Returns whether it has changed. `still`: whether light that stands still is shown. */
  update(lamps: readonly Lamp[], still = true): boolean {
    const suns = sunsWithSky(lamps);
    const turning = turningOf(lamps);
    const factor = this.factor(still, turning);
    // As the columns are: clockwise seen from above.
    const shift = ((turning?.angle ?? 0) / 360) * this.texture.image.width;
    const key = [factor.join(), shift, ...suns.map(({ value, color, intensity }) => [...value.toArray(), ...color.toArray(), intensity].join())].join(";");
    if (key === this.drawn) return false;
    this.drawn = key;
    const { data, width, height } = this.texture.image as unknown as { data: Uint16Array; width: number; height: number };
    for (let column = 0; column < width; column++) {
      // As three.js looks a direction up: u = atan2(z, x) / 2π + ½.
      const around = 2 * Math.PI * ((column + 0.5) / width - 0.5);
      const above = suns.length === 0 ? [] : Array.from({ length: STEPS + 1 }, (_, k) => {
        const up = (k / STEPS) * (Math.PI / 2);
        return radiance(suns, [Math.cos(up) * Math.cos(around), Math.sin(up), Math.cos(up) * Math.sin(around)]);
      });
      for (let row = 0; row < height; row++) {
        const step = STEPS * (2 * ((row + 0.5) / height) - 1);
        const [low, high] = [above[Math.floor(step)], above[Math.floor(step) + 1]];
        const at = 4 * (row * width + column);
        for (let c = 0; c < 3; c++) {
          // Suns have no sky under the horizon.
          const sky = low && high ? low[c]! + (step % 1) * (high[c]! - low[c]!) : 0;
          data[at + c] = DataUtils.toHalfFloat(Math.min(sky + factor[c]! * this.texel(column - shift, row, c), MOST));
        }
        data[at + 3] = DataUtils.toHalfFloat(1);
      }
    }
    this.renew();
    return true;
  }

  dispose(): void {
    this.texture.dispose();
  }

  /** What the picture of the environment is multiplied by. */
  private factor(still: boolean, turning: TurningLamp | null): readonly [number, number, number] {
    const { environment } = this;
    if (!environment || (!still && !turning)) return [0, 0, 0];
    const { radiance: [r, g, b] } = environment;
    const lamp = turning ?? environment.lamp;
    if (!lamp) return [r, g, b];
    const { color, intensity } = lamp;
    return [r * color.r * intensity, g * color.g * intensity, b * color.b * intensity];
  }

  /** The picture of the environment, whose first row is the last one here, between two columns. */
  private texel(place: number, row: number, c: number): number {
    const picture = this.environment?.picture;
    if (!picture) return 1;
    const { width, height, texels } = picture;
    const first = Math.floor(place);
    const at = (column: number) => texels[3 * ((height - 1 - row) * width + (((column % width) + width) % width)) + c]!;
    const share = place - first;
    return share > 0 ? (1 - share) * at(first) + share * at(first + 1) : at(first);
  }

  /** Have the picture uploaded again. `WebGLRenderer` keeps a cube map of it for as long as it is not disposed of. */
  private renew(): void {
    this.texture.dispose();
    this.texture.needsUpdate = true;
  }
}

/** Radiance of all skies in a direction. */
function radiance(suns: readonly SunLamp[], view: readonly [number, number, number]): [number, number, number] {
  const sum: [number, number, number] = [0, 0, 0];
  for (const { variable, time, value, color, intensity } of suns) {
    const tint = [color.r, color.g, color.b];
    skyAt(variable.sky!, time, [value.x, value.y, value.z], view).forEach((x, i) => {
      sum[i]! += x * tint[i]! * intensity;
    });
  }
  return sum;
}
