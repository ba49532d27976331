/** The declared lights as three.js lights with shadow maps. */

import { type Box3, Color, DirectionalLight, type Light, PointLight, Vector3 } from "three";
import { Arc } from "./arc.ts";
import type { Placement } from "./placement.ts";
import { SHADOW_RADIUS } from "./shadow-lift.ts";
import { levelAt, sunlightAt } from "./sky.ts";
import type { TurningVariable } from "./turning.ts";
import type { PointVariable, SunVariable, Variable } from "./variables.ts";

const POINT_SHADOW_SIZE = 1024;
/** Edge of a sun's shadow map, texels; twice that where the diagonal of what is looked at is longer than `WIDE` metres. */
const SUN_SHADOW_SIZE = 2048;
const WIDE = 20;
/** Nearest occluder of a point light as a share of the diagonal of what is looked at. */
const NEAR_SHARE = 5e-4;
/** Half the edge of a sun's shadow map over that of what it must hold: a filter at the rim stays inside. */
const SUN_MARGIN = 1.02;
/** A light has been moved by hand when it is farther than this from where it was put, as a share of its distance from the origin. */
const MOVED = 1e-5;

/** A declared light: what the rasteriser casts and what its field is told. */
export interface Lamp {
  readonly variable: Variable;
  /** The three.js light, which may be moved, coloured and dimmed as any other: `follow` takes it up. */
  readonly object: Light;
  /** The field's input `light`, in the space of the scene's root: a position, or a unit direction to the sun, or of the north of an environment. */
  readonly value: Vector3;
  readonly color: Color;
  intensity: number;
  /** What the learned light is multiplied by beside colour and intensity: the brightness of the time of day. */
  readonly level: number;
  /** Counts what a shadow map must be drawn anew for. */
  readonly shadowVersion: number;
  /** Hang the light on the root of its scene. */
  attach(): void;
  /** Take it off again. */
  detach(): void;
  /** Move the light; returns whether the wish had to be clamped to what was learned. */
  move(value: Vector3): boolean;
  /** The world around the light has moved. */
  renewShadow(): void;
  /** Take up what was done to the three.js light, and where the root stands; call before drawing. */
  follow(): void;
  /** Carry `color` and `intensity` over to the three.js light; what was done to these of the light since counts. */
  tint(): void;
  dispose(): void;
}

/** The lamp of a declared light in a scene with the given bounds and the part of them that is looked at (of the root's space). */
export function createLamp(variable: Exclude<Variable, TurningVariable>, bounds: Box3, placement: Placement, core = bounds): Lamp {
  return variable.kind === "point" ? new PointLamp(variable, bounds, placement, core) : new SunLamp(variable, bounds, placement, core);
}

/** What both kinds share: colour, intensity, and the version of their shadow. */
abstract class DeclaredLamp<V extends Variable, L extends PointLight | DirectionalLight> implements Lamp {
  readonly variable: V;
  readonly object: L;
  readonly value = new Vector3();
  readonly color: Color;
  intensity: number;
  level = 1;
  shadowVersion = 0;
  /** What the colour of the three.js light is multiplied by: that of the sun at the time of day. */
  protected readonly filter = new Color(1, 1, 1);
  protected readonly placement: Placement;
  /** Scale of the world that the light was fitted to. */
  protected scale = 1;
  /** What was last given to the light; no intensity before the first time. */
  private readonly given = { color: new Color(), intensity: null as number | null };

  constructor(variable: V, object: L, placement: Placement) {
    this.variable = variable;
    this.object = object;
    this.placement = placement;
    this.color = new Color(...variable.color);
    this.intensity = variable.intensity;
    object.name = variable.name;
    object.castShadow = true;
    object.shadow.autoUpdate = false;
    object.shadow.radius = SHADOW_RADIUS;
  }

  abstract move(value: Vector3): boolean;
  /** Factor of the intensity in a world of this scale. */
  protected abstract gain(scale: number): number;
  protected abstract fitShadow(): void;
  /** The value that the three.js light has by now. */
  protected abstract seen(target: Vector3): Vector3;

  attach(): void {
    this.placement.root.add(this.object);
    this.fitShadow();
  }

  detach(): void {
    this.object.removeFromParent();
  }

  renewShadow(): void {
    this.fitShadow();
  }

  follow(): void {
    const { scale } = this.placement;
    if (scale !== this.scale) {
      this.scale = scale;
      this.fitShadow();
    }
    const seen = this.seen(new Vector3());
    if (seen.distanceTo(this.value) > MOVED * Math.max(1, this.value.length())) this.move(seen);
    this.tint();
  }

  tint(): void {
    const { object, given } = this;
    const gain = this.gain(this.scale);
    if (given.intensity !== null) {
      if (!object.color.equals(given.color)) this.color.copy(object.color).multiply(inverse(this.filter));
      if (object.intensity !== given.intensity) this.intensity = object.intensity / gain;
    }
    object.color.copy(this.color).multiply(this.filter);
    object.intensity = this.intensity * gain;
    given.color.copy(object.color);
    given.intensity = object.intensity;
  }

  dispose(): void {
    this.detach();
    this.object.dispose();
  }
}

const diagonalOf = ({ min, max }: Box3): number => Math.max(min.distanceTo(max), 1e-6);

/** One over a colour; 0 where it is 0. */
function inverse({ r, g, b }: Color): Color {
  const over = (x: number) => (x > 0 ? 1 / x : 0);
  return new Color(over(r), over(g), over(b));
}

/** A point light in candela with inverse-square falloff and a cube shadow map. */
export class PointLamp extends DeclaredLamp<PointVariable, PointLight> {
  private readonly low: Vector3;
  private readonly high: Vector3;
  /** Distances of the nearest and the farthest occluder, metres of the root. */
  private readonly near: number;
  private readonly far: number;

  constructor(variable: PointVariable, bounds: Box3, placement: Placement, core = bounds) {
    super(variable, new PointLight(0xffffff, 1, 0, 2), placement);
    this.low = new Vector3(...variable.low);
    this.high = new Vector3(...variable.high);
    const diagonal = (box: Box3) => diagonalOf(box.clone().expandByPoint(this.low).expandByPoint(this.high));
    this.near = NEAR_SHARE * diagonal(core);
    this.far = 1.01 * diagonal(bounds);
    this.object.shadow.mapSize.set(POINT_SHADOW_SIZE, POINT_SHADOW_SIZE);
    this.fitShadow();
    this.move(new Vector3(...variable.initial));
    this.tint();
  }

  move(value: Vector3): boolean {
    this.value.copy(value).clamp(this.low, this.high);
    this.placement.put(this.object, this.value);
    this.shadowVersion++;
    return this.value.distanceToSquared(value) > 1e-12;
  }

  /** Distances grow with the scale, and light falls off with their square. */
  protected gain(scale: number): number {
    return scale * scale;
  }

  protected fitShadow(): void {
    const { camera } = this.object.shadow;
    camera.near = this.scale * this.near;
    camera.far = this.scale * this.far;
    camera.updateProjectionMatrix();
    this.shadowVersion++;
  }

  protected seen(target: Vector3): Vector3 {
    return this.placement.pointOf(this.object, target);
  }
}

/** A distant light in lux, with a shadow map that fits what is looked at as the sun sees it; all of the scene casts into it. */
export class SunLamp extends DeclaredLamp<SunVariable, DirectionalLight> {
  readonly arc: Arc;
  /** Where on the arc the sun is, 0 to 1. */
  time = 0;
  /** What is looked at. */
  private readonly core: Box3;
  /** How far from its middle the three.js light stands: all that casts is nearer. */
  private readonly distance: number;

  constructor(variable: SunVariable, bounds: Box3, placement: Placement, core = bounds) {
    super(variable, new DirectionalLight(0xffffff, 1), placement);
    this.arc = new Arc(variable.start, variable.middle, variable.end);
    this.core = core;
    this.distance = 2 * diagonalOf(bounds);
    this.object.shadow.mapSize.setScalar(SUN_SHADOW_SIZE * (diagonalOf(core) > WIDE ? 2 : 1));
    this.move(new Vector3(...variable.initial));
    this.tint();
  }

  override attach(): void {
    this.placement.root.add(this.object.target);
    super.attach();
  }

  override detach(): void {
    super.detach();
    this.object.target.removeFromParent();
  }

  /** Any direction is taken as it is: the slider keeps to the arc, saved views lie on it. */
  move(value: Vector3): boolean {
    this.value.copy(value).normalize();
    this.time = this.arc.time(this.value);
    const { sky } = this.variable;
    if (sky) {
      this.level = levelAt(sky, this.time);
      this.filter.setRGB(...sunlightAt(sky, this.time));
    }
    const center = this.core.getCenter(new Vector3());
    this.placement.put(this.object.target, center);
    this.placement.put(this.object, center.addScaledVector(this.value, this.distance));
    this.fitShadow();
    return false;
  }

  protected gain(): number {
    return 1;
  }

  protected fitShadow(): void {
    const { object } = this;
    const { camera } = object.shadow;
    object.updateWorldMatrix(true, false);
    object.target.updateWorldMatrix(true, false);
    object.shadow.updateMatrices(object);
    const toSun = camera.matrixWorldInverse.clone().multiply(this.placement.root.matrixWorld);
    const { min, max } = this.core.clone().applyMatrix4(toSun);
    // The middle of what is looked at lies on the axis of this camera.
    const reach = SUN_MARGIN * Math.max(max.x, max.y);
    camera.right = camera.top = reach;
    camera.left = camera.bottom = -reach;
    // From the light to the last surface that is looked at, and a little more.
    camera.near = 0;
    camera.far = 0.1 * reach - min.z;
    camera.updateProjectionMatrix();
    this.shadowVersion++;
  }

  /** As three.js has it: from the target to the light. */
  protected seen(target: Vector3): Vector3 {
    const from = this.placement.pointOf(this.object.target, new Vector3());
    return this.placement.pointOf(this.object, target).sub(from).normalize();
  }
}

/** The suns among lamps that have a sky. */
export function sunsWithSky(lamps: readonly Lamp[]): SunLamp[] {
  return lamps.filter((lamp): lamp is SunLamp => lamp instanceof SunLamp && lamp.variable.sky !== null);
}

/** Sees to it that every renderer draws the shadow maps anew after a change. */
export class ShadowKeeper {
  /** Versions that a renderer has drawn, by what it keeps its resources in: a restored context has a new one. */
  private readonly drawn = new WeakMap<object, string>();

  /** Ask for the shadow maps that this renderer has not drawn yet. */
  ask(lamps: readonly Lamp[], renderer: object): void {
    const key = ((renderer as { properties?: object }).properties ?? renderer) as object;
    const version = lamps.map((lamp) => lamp.shadowVersion).join();
    if (this.drawn.get(key) === version) return;
    this.drawn.set(key, version);
    for (const { object } of lamps) {
      const { shadow } = object as Partial<PointLight>;
      if (shadow) shadow.needsUpdate = true;
    }
  }
}

