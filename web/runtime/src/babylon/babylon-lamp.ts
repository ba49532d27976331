/** A declared light as a light of Babylon.js, with its shadow map. */

import { DirectionalLight } from "@babylonjs/core/Lights/directionalLight.js";
import { PointLight } from "@babylonjs/core/Lights/pointLight.js";
import { ShadowGenerator } from "@babylonjs/core/Lights/Shadows/shadowGenerator.js";
import "@babylonjs/core/Lights/Shadows/shadowGeneratorSceneComponent.js";
import type { Effect } from "@babylonjs/core/Materials/effect.js";
import { Color3 } from "@babylonjs/core/Maths/math.color.js";
import { Matrix, Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import type { AbstractMesh } from "@babylonjs/core/Meshes/abstractMesh.js";
import type { Scene } from "@babylonjs/core/scene.js";
import type { Vec3 } from "../checks.ts";
import type { EngineLamp } from "../engines/engine-lamp.ts";
import { pointShadow, sunShadow } from "../engines/point-shadow.ts";

const POINT_SHADOW_SIZE = 1024;
const SUN_SHADOW_SIZE = 2048;
/** Nearest occluder of a point light as a share of the diagonal of what is looked at. */
const NEAR_SHARE = 5e-4;
/** The light has been moved by hand when it is farther than this from where it was put. */
const MOVED = 1e-5;
/** Clip space as coordinates of a map: x, y and depth from 0 to 1. */
const TO_MAP = Matrix.Scaling(0.5, 0.5, 0.5).multiply(Matrix.Translation(0.5, 0.5, 0.5));

/** Where the baked scene stands, and what it consists of. */
export interface Stand {
  readonly root: AbstractMesh;
  readonly meshes: readonly AbstractMesh[];
  /** Diagonal of the scene, metres of the world. */
  readonly diagonal: number;
  /** Diagonal of the part that is looked at. */
  readonly core: number;
  readonly toWorld: Matrix;
  readonly toFile: Matrix;
}

/** Follows what is done to the light: it may be moved, coloured and dimmed as any other. */
export class BabylonLamp {
  /** It hangs on the root of the file, and lights what is not of the file as any other light does. */
  readonly object: PointLight | DirectionalLight;
  readonly shadows: ShadowGenerator;
  private readonly lamp: EngineLamp;
  private readonly index: number;
  private readonly stand: Stand;
  private readonly given = { color: new Color3(), intensity: Number.NaN };
  private drawn = "";

  constructor(lamp: EngineLamp, index: number, scene: Scene, stand: Stand) {
    this.lamp = lamp;
    this.index = index;
    this.stand = stand;
    const isPoint = lamp.variable.kind === "point";
    this.object = isPoint ? new PointLight(lamp.variable.name, Vector3.Zero(), scene) : new DirectionalLight(lamp.variable.name, Vector3.Down(), scene);
    this.object.parent = stand.root;
    this.object.excludedMeshes.push(...stand.meshes);
    this.put();
    this.tint();
    this.shadows = new ShadowGenerator(isPoint ? POINT_SHADOW_SIZE : SUN_SHADOW_SIZE, this.object, true);
    this.shadows.bias = 0;
    const map = this.shadows.getShadowMap()!;
    map.renderList = [...stand.meshes];
    map.refreshRate = 0;
  }

  /** Move the lamp, in the space of the file; returns whether the wish had to be clamped to what was learned. */
  move(wish: Vec3): boolean {
    const clamped = this.lamp.move(wish);
    this.put();
    return clamped;
  }

  /** Take up what was done to the light; call before drawing. */
  follow(): void {
    const { object, lamp, given } = this;
    const seen = this.seen();
    if (Math.hypot(...seen.map((x, i) => x - lamp.value[i]!)) > MOVED) this.move(seen);
    if (!object.diffuse.equals(given.color)) lamp.color = [object.diffuse.r, object.diffuse.g, object.diffuse.b];
    if (object.intensity !== given.intensity) lamp.intensity = object.intensity;
    this.tint();
    this.fitShadow();
  }

  /** Names of uniforms and samplers that `code` reads. */
  get uniforms(): string[] {
    return ["At", "Depth", "ToMap"].map((name) => `lightwellShadow${name}${this.index}`);
  }

  get sampler(): string {
    return `lightwellShadowMap${this.index}`;
  }

  /** GLSL of the test of the lamp's shadow. */
  get code(): string {
    const { index, sampler } = this;
    const [at, depth, toMap] = this.uniforms as [string, string, string];
    if (this.lamp.variable.kind === "sun")
      return `uniform mat4 ${toMap};\nuniform vec4 ${at};\nuniform sampler2D ${sampler};\n${sunShadow(index, toMap, `${at}.xyz`, `${at}.w`, `textureLod( ${sampler}, uv, 0.0 ).x`)}`;
    // Babylon.js keeps ( distance + x ) / y, upside down.
    const stored = `textureLod( ${sampler}, vec3( direction.x, - direction.y, direction.z ), 0.0 ).x * ${depth}.y - ${depth}.x`;
    return `uniform vec4 ${at};\nuniform vec2 ${depth};\nuniform samplerCube ${sampler};\n${pointShadow(index, `${at}.xyz`, `${at}.w`, stored)}`;
  }

  /** Give the shader what `code` reads. */
  bind(effect: Effect): void {
    const { object, shadows } = this;
    const [at, depth, toMap] = this.uniforms as [string, string, string];
    const map = shadows.getShadowMap()!;
    const isPoint = object instanceof PointLight;
    const place = isPoint ? object.getAbsolutePosition() : Vector3.TransformNormal(new Vector3(...this.lamp.value), this.stand.toWorld).normalize();
    effect.setFloat4(at, place.x, place.y, place.z, map.getRenderWidth());
    const [near, far] = [object.shadowMinZ ?? 0, object.shadowMaxZ ?? 1];
    if (isPoint) effect.setFloat2(depth, near, near + far);
    else effect.setMatrix(toMap, shadows.getTransformMatrix().multiply(TO_MAP));
    effect.setTexture(this.sampler, map);
  }

  dispose(): void {
    this.shadows.dispose();
    this.object.dispose();
  }

  /** Where the light is by now, in the space of the file. */
  private seen(): Vec3 {
    const { object, stand } = this;
    if (object instanceof DirectionalLight) {
      object.computeTransformedInformation();
      const { x, y, z } = Vector3.TransformNormal(object.transformedDirection ?? object.direction, stand.toFile).normalize();
      return [-x, -y, -z];
    }
    if (object.parent === stand.root) return [object.position.x, object.position.y, object.position.z];
    const { x, y, z } = Vector3.TransformCoordinates(object.getAbsolutePosition(), stand.toFile);
    return [x, y, z];
  }

  /** Put the light where the lamp is. */
  private put(): void {
    const { object, lamp, stand } = this;
    const value = new Vector3(...lamp.value);
    if (object instanceof DirectionalLight) {
      object.parent = stand.root;
      object.direction = value.negate();
      return;
    }
    const parent = object.parent === stand.root ? null : object.parent;
    object.position = object.parent === stand.root ? value : Vector3.TransformCoordinates(value, stand.toWorld);
    if (parent) object.position = Vector3.TransformCoordinates(object.position, Matrix.Invert(parent.getWorldMatrix()));
  }

  private tint(): void {
    const { object, lamp, given } = this;
    object.diffuse = new Color3(...lamp.color);
    object.intensity = lamp.intensity;
    given.color.copyFrom(object.diffuse);
    given.intensity = object.intensity;
  }

  /** Draw the shadow map anew when lamp or scene have moved. */
  private fitShadow(): void {
    const { object, stand, lamp, shadows } = this;
    const key = [...lamp.value, ...stand.toWorld.asArray(), shadows.getShadowMap()!.renderList?.length].join();
    if (key === this.drawn) return;
    this.drawn = key;
    object.shadowMinZ = stand.core * NEAR_SHARE;
    object.shadowMaxZ = stand.diagonal * 1.01;
    if (object instanceof DirectionalLight) {
      object.shadowMinZ = object.shadowMaxZ = undefined as never;
      object.autoCalcShadowZBounds = true;
    }
    shadows.getShadowMap()!.resetRefreshCounter();
  }
}
