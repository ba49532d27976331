/** The arc that a sun runs along: the circle on the unit sphere through three directions. */

import { Vector3 } from "three";
import type { Vec3 } from "./checks.ts";

/** `at(0)`, `at(½)` and `at(1)` are the three directions; the angle grows linearly within each half. */
export class Arc {
  private readonly start: Vector3;
  /** Axis of the circle; zero when the directions coincide. */
  private readonly axis: Vector3;
  /** Angles from start to middle and from start to end, radians, both towards the middle. */
  private readonly toMiddle: number;
  private readonly toEnd: number;

  constructor(start: Vec3, middle: Vec3, end: Vec3) {
    this.start = new Vector3(...start).normalize();
    const b = new Vector3(...middle).normalize();
    const c = new Vector3(...end).normalize();
    this.axis = new Vector3().crossVectors(b.clone().sub(this.start), c.clone().sub(this.start));
    // There and back again: start and end coincide, so any circle through start and middle will do.
    if (this.axis.lengthSq() < 1e-12) this.axis.crossVectors(this.start, b);
    this.axis.normalize();
    this.toMiddle = this.angle(b);
    const toEnd = this.angle(c);
    this.toEnd = toEnd < this.toMiddle ? toEnd + 2 * Math.PI : toEnd;
  }

  /** Unit direction to the sun at t in [0, 1]. */
  at(t: number, target = new Vector3()): Vector3 {
    const angle =
      t < 0.5 ? 2 * t * this.toMiddle : this.toMiddle + (2 * t - 1) * (this.toEnd - this.toMiddle);
    return target.copy(this.start).applyAxisAngle(this.axis, angle);
  }

  /** The t of a direction on the arc; that of the nearest end beside it. */
  time(direction: Vector3): number {
    const angle = this.angle(direction);
    if (angle > this.toEnd + (2 * Math.PI - this.toEnd) / 2) return 0;
    const kept = Math.min(angle, this.toEnd);
    return kept < this.toMiddle ? kept / (2 * this.toMiddle) : 0.5 + (kept - this.toMiddle) / (2 * (this.toEnd - this.toMiddle));
  }

  /** Angle about the axis from `start` to `direction`, in [0, 2π). */
  private angle(direction: Vector3): number {
    const inPlane = (v: Vector3) => v.clone().addScaledVector(this.axis, -v.dot(this.axis));
    const a = inPlane(this.start);
    const b = inPlane(direction);
    const angle = Math.atan2(new Vector3().crossVectors(a, b).dot(this.axis), a.dot(b));
    return angle < 0 ? angle + 2 * Math.PI : angle;
  }
}
