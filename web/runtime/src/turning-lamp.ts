/** The environment map that turns, as a declared light: nothing of it is rasterised but the picture behind the scene. */

import { AmbientLight, Color, Vector3 } from "three";
import type { Lamp } from "./lamp.ts";
import { angleInRange, angleOf, northAt, type TurningVariable } from "./turning.ts";

/** The map has been turned by hand when its north is farther from where it was put. */
const MOVED = 1e-5;
const NORTH = new Vector3(0, 0, -1);
const UP = new Vector3(0, 1, 0);

/** Its three.js light shines on nothing: it is the handle by which the map is turned about its y axis, dimmed and tinted. */
export class TurningLamp implements Lamp {
  readonly variable: TurningVariable;
  readonly object = new AmbientLight(0xffffff, 1);
  readonly value = new Vector3();
  readonly color: Color;
  intensity: number;
  readonly level = 1;
  readonly shadowVersion = 0;
  private readonly root: { add(object: AmbientLight): unknown };
  /** What was last given to the light; no intensity before the first time. */
  private readonly given = { color: new Color(), intensity: null as number | null };

  /** Args: the variable; the root of its scene. */
  constructor(variable: TurningVariable, root: { add(object: AmbientLight): unknown }) {
    this.variable = variable;
    this.root = root;
    this.color = new Color(...variable.color);
    this.intensity = variable.intensity;
    this.object.name = variable.name;
    // Lights that are not visible are left out of all shaders.
    this.object.visible = false;
    this.move(new Vector3(...variable.initial));
    this.tint();
  }

  /** Angle by which the map is turned, degrees clockwise seen from above. */
  get angle(): number {
    return angleOf(this.variable, this.value.toArray());
  }

  /** Turn the map: degrees clockwise seen from above. Returns whether it is turned so far; where it is not, nothing changes. */
  turn(degrees: number): boolean {
    const angle = angleInRange(this.variable, degrees);
    if (angle !== null) this.move(new Vector3(...northAt(angle)));
    return angle !== null;
  }

  attach(): void {
    this.root.add(this.object);
  }

  detach(): void {
    this.object.removeFromParent();
  }

  move(value: Vector3): boolean {
    this.value.set(...northAt(angleOf(this.variable, value.toArray())));
    this.object.setRotationFromAxisAngle(UP, -Math.atan2(this.value.x, -this.value.z));
    return this.value.distanceTo(value.clone().normalize()) > MOVED;
  }

  renewShadow(): void {}

  follow(): void {
    const seen = NORTH.clone().applyQuaternion(this.object.quaternion);
    if (seen.distanceTo(this.value) > MOVED) this.move(seen);
    this.tint();
  }

  tint(): void {
    const { object, given } = this;
    if (given.intensity !== null) {
      if (!object.color.equals(given.color)) this.color.copy(object.color);
      if (object.intensity !== given.intensity) this.intensity = object.intensity;
    }
    object.color.copy(this.color);
    object.intensity = this.intensity;
    given.color.copy(this.color);
    given.intensity = this.intensity;
  }

  dispose(): void {
    this.detach();
    this.object.dispose();
  }
}
