/** The sky behind a scene, drawn from the numbers of its suns. */

import { ClampToEdgeWrapping, DataTexture, DataUtils, EquirectangularReflectionMapping, HalfFloatType, LinearFilter, RepeatWrapping, RGBAFormat } from "three";
import { type Lamp, type SunLamp, sunsWithSky } from "./lamp.ts";
import { skyAt } from "./sky.ts";

/** Columns and rows of the picture: 2.8 degrees a texel, finer than the glow about the sun. */
const WIDTH = 128;
const HEIGHT = 64;
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
    for (let row = 0; row < HEIGHT; row++) {
      const up = Math.sin(Math.PI * ((row + 0.5) / HEIGHT - 0.5));
      const flat = Math.sqrt(1 - up * up);
      for (let column = 0; column < WIDTH; column++) {
        // As three.js looks a direction up: u = atan2(z, x) / 2π + ½.
        const around = 2 * Math.PI * ((column + 0.5) / WIDTH - 0.5);
        const texel = radiance(suns, [flat * Math.cos(around), up, flat * Math.sin(around)]);
        data.set([...texel.map((x) => DataUtils.toHalfFloat(Math.min(x, MOST))), DataUtils.toHalfFloat(1)], 4 * (row * WIDTH + column));
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
  if (view[1] < 0) return sum;
  for (const { variable, time, value, color, intensity } of suns) {
    const tint = [color.r, color.g, color.b];
    skyAt(variable.sky!, time, [value.x, value.y, value.z], view).forEach((x, i) => {
      sum[i]! += x * tint[i]! * intensity;
    });
  }
  return sum;
}
