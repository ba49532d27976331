/** Exposure: that of the scene, stopped down for a view that is very bright, and the user's stops on top. */

import type { DataTexture } from "three";
import { meterExposure, type Picture } from "./readback.ts";
import { calmExposure } from "./reference-pictures.ts";

export class Exposure {
  /** Stops on top of what was metered. */
  stops = 0;
  /** Given by the address; then nothing is metered. */
  private readonly fixed: number | null;
  private scene = 1;
  private base = 1;

  constructor(fixed: number | null) {
    this.fixed = fixed;
  }

  /** Linear factor before tone mapping. */
  get value(): number {
    return this.base * 2 ** this.stops;
  }

  /** Choose the linear factor: as stops on top of what was metered. */
  choose(value: number): void {
    this.stops = Math.log2(value / this.base);
  }

  /** Take the scene's exposure from the page (or the address), or from what is shown; returns whether it was metered. */
  meter(declared: number | null | undefined, shown: () => Picture<Float32Array>): boolean {
    const known = this.fixed ?? declared ?? null;
    this.scene = known ?? meterExposure(shown());
    this.base = this.scene;
    return known === null;
  }

  /** Forget what a view asked for. */
  reset(): void {
    this.base = this.scene;
  }

  /** Stop down where a lamp is so near that the picture of a view would be washed out. */
  adapt(picture: DataTexture): void {
    if (this.fixed === null) this.base = Math.min(this.scene, calmExposure(picture));
  }
}
