/** The sky behind a scene, drawn from the numbers of its suns. */

import { ClampToEdgeWrapping, DataTexture, DataUtils, EquirectangularReflectionMapping, HalfFloatType, LinearFilter, RepeatWrapping, RGBAFormat } from "three";
import { type Lamp, type SunLamp, sunsWithSky } from "./lamp.ts";
import { skyAt } from "./sky.ts";

/** Columns and rows of the picture: rows of 0.7 degrees, so that the horizon is a line. */
const WIDTH = 128;
const HEIGHT = 256;
/** Steps from the horizon to the zenith at which the sky is evaluated: 2.8 degrees, finer than the glow about the sun. */
const STEPS = 32;
/** Largest value of the picture: half floats end at 65,504. */
const MOST = 65_000;

/** A picture for `scene.background`, which follows the suns that have a sky; the root of the scene must not be turned. */
export class SkyBackground {
  readonly texture = new DataTexture(new Uint16Array(4 * WIDTH * HEIGHT), WIDTH, HEIGHT, RGBAFormat, HalfFloatType);
  private drawn = "";

  constructor() {
    this.texture.mapping = EquirectangularReflectionMapping;
    this.texture.minFilter = this.texture.magFilter = LinearFilter;
    this.texture.wrapS = RepeatWrapping;
    this.texture.wrapT = ClampToEdgeWrapping;
  }

  /** Bring the picture up to date; call before drawing. Returns whether it has changed. */
  update(lamps: readonly Lamp[]): boolean {
    const suns = sunsWithSky(lamps);
    const key = suns.map(({ value, color, intensity }) => [...value.toArray(), ...color.toArray(), intensity].join()).join(";");
    if (key === this.drawn) return false;
    this.drawn = key;
    const { data } = this.texture.image as unknown as { data: Uint16Array };
    for (let column = 0; column < WIDTH; column++) {
      // As three.js looks a direction up: u = atan2(z, x) / 2π + ½.
      const around = 2 * Math.PI * ((column + 0.5) / WIDTH - 0.5);
      const above = Array.from({ length: STEPS + 1 }, (_, k) => {
        const up = (k / STEPS) * (Math.PI / 2);
        return radiance(suns, [Math.cos(up) * Math.cos(around), Math.sin(up), Math.cos(up) * Math.sin(around)]);
      });
      for (let row = 0; row < HEIGHT; row++) {
        const step = STEPS * (2 * ((row + 0.5) / HEIGHT) - 1);
        const [low, high] = [above[Math.floor(step)], above[Math.floor(step) + 1]];
        // There is no sky under the horizon.
        const texel = low && high ? low.map((x, c) => x + (step % 1) * (high[c]! - x)) : [0, 0, 0];
        data.set([...texel, 1].map((x) => DataUtils.toHalfFloat(Math.min(x, MOST))), 4 * (row * WIDTH + column));
      }
    }
    this.texture.needsUpdate = true;
    return true;
  }

  dispose(): void {
    this.texture.dispose();
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
