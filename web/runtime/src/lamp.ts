/** The declared lights as three.js lights with shadow maps. */

import { type Box3, Color, DirectionalLight, type Object3D, PointLight, Sphere, Vector3 } from "three";
import { Arc } from "./arc.ts";
import type { PointVariable, SunVariable, Variable } from "./variables.ts";

/** Radius of the percentage-closer filter in shadow-map texels. */
export const SHADOW_RADIUS = 1.5;
const POINT_SHADOW_SIZE = 1024;
const SUN_SHADOW_SIZE = 2048;
/** Nearest occluder of a point light as a share of the scene's diagonal. */
const NEAR_SHARE = 5e-4;

/** A declared light: what the rasteriser casts and what its field is told. */
export interface Lamp {
  readonly variable: Variable;
  /** Holds the three.js light; add it to the scene. */
  readonly object: Object3D;
  /** The field's input `light`: a position, or a unit direction to the sun. */
  readonly value: Vector3;
  readonly color: Color;
  intensity: number;
  /** Move the light; returns whether the wish had to be clamped to what was learned. */
  move(value: Vector3): boolean;
  /** Carry `color` and `intensity` over to the three.js light. */
  tint(): void;
  dispose(): void;
}

/** The lamp of a declared light in a scene with the given bounds. */
export function createLamp(variable: Variable, bounds: Box3): Lamp {
  return variable.kind === "point" ? new PointLamp(variable, bounds) : new SunLamp(variable, bounds);
}

/** A point light in candela with inverse-square falloff and a cube shadow map. */
export class PointLamp implements Lamp {
  readonly variable: PointVariable;
  readonly object: PointLight;
  readonly value = new Vector3();
  readonly color: Color;
  intensity: number;
  private readonly low: Vector3;
  private readonly high: Vector3;

  constructor(variable: PointVariable, bounds: Box3) {
    this.variable = variable;
    this.low = new Vector3(...variable.low);
    this.high = new Vector3(...variable.high);
    this.color = new Color(...variable.color);
    this.intensity = variable.intensity;
    this.object = new PointLight(this.color, this.intensity, 0, 2);
    this.object.name = variable.name;
    fitPointShadow(this.object, bounds, this.low, this.high);
    this.move(new Vector3(...variable.initial));
    this.tint();
  }

  move(value: Vector3): boolean {
    this.value.copy(value).clamp(this.low, this.high);
    this.object.position.copy(this.value);
    this.object.shadow.needsUpdate = true;
    return this.value.distanceToSquared(value) > 1e-12;
  }

  tint(): void {
    this.object.color.copy(this.color);
    this.object.intensity = this.intensity;
  }

  dispose(): void {
    this.object.dispose();
  }
}

function fitPointShadow(light: PointLight, bounds: Box3, low: Vector3, high: Vector3): void {
  const reach = bounds.clone().expandByPoint(low).expandByPoint(high);
  const diagonal = Math.max(reach.getSize(new Vector3()).length(), 1e-6);
  light.castShadow = true;
  light.shadow.autoUpdate = false;
  light.shadow.mapSize.set(POINT_SHADOW_SIZE, POINT_SHADOW_SIZE);
  light.shadow.radius = SHADOW_RADIUS;
  light.shadow.camera.near = diagonal * NEAR_SHARE;
  light.shadow.camera.far = diagonal * 1.01;
}

/** A distant light in lux, with a shadow map that fits the scene's bounding sphere. */
export class SunLamp implements Lamp {
  readonly variable: SunVariable;
  readonly object: DirectionalLight;
  readonly value = new Vector3();
  readonly color: Color;
  readonly arc: Arc;
  intensity: number;
  private readonly reach: Sphere;

  constructor(variable: SunVariable, bounds: Box3) {
    this.variable = variable;
    this.arc = new Arc(variable.start, variable.middle, variable.end);
    this.reach = bounds.getBoundingSphere(new Sphere());
    this.color = new Color(...variable.color);
    this.intensity = variable.intensity;
    this.object = new DirectionalLight(this.color, this.intensity);
    this.object.name = variable.name;
    this.object.add(this.object.target);
    fitSunShadow(this.object, this.reach.radius);
    this.move(new Vector3(...variable.initial));
    this.tint();
  }

  /** Any direction is taken as it is: the slider keeps to the arc, saved views lie on it. */
  move(value: Vector3): boolean {
    this.value.copy(value).normalize();
    this.object.position.copy(this.reach.center).addScaledVector(this.value, 2 * this.reach.radius);
    this.object.target.position.copy(this.value).multiplyScalar(-2 * this.reach.radius);
    this.object.shadow.needsUpdate = true;
    return false;
  }

  tint(): void {
    this.object.color.copy(this.color);
    this.object.intensity = this.intensity;
  }

  dispose(): void {
    this.object.dispose();
  }
}

function fitSunShadow(light: DirectionalLight, radius: number): void {
  light.castShadow = true;
  light.shadow.autoUpdate = false;
  light.shadow.mapSize.set(SUN_SHADOW_SIZE, SUN_SHADOW_SIZE);
  light.shadow.radius = SHADOW_RADIUS;
  const camera = light.shadow.camera;
  [camera.left, camera.right, camera.bottom, camera.top] = [-radius, radius, -radius, radius];
  [camera.near, camera.far] = [radius * 0.9, radius * 3.1];
  camera.updateProjectionMatrix();
}
