/** What stands in the scene: the loaded file, its lamps, and their visible bodies. */

import { type Lamp, LearnedScene, type Look, type Parts, type WeightPlacement } from "lightwell";
import { type PerspectiveCamera, Scene, type WebGLRenderer, type WebGLRenderTarget } from "three";
import type { LoadedAsset } from "./asset.ts";
import { Surroundings } from "./surroundings.ts";
import { TestObject } from "./test-object.ts";

/** Owns the scene graph. */
export class Stage {
  readonly scene = new Scene();
  learned: LearnedScene | null = null;
  /** What the probes of the file light; null where it has none. */
  object: TestObject | null = null;
  private readonly renderer: WebGLRenderer;
  private surroundings: Surroundings | null = null;

  constructor(renderer: WebGLRenderer) {
    this.renderer = renderer;
  }

  get lamps(): readonly Lamp[] {
    return this.learned?.lamps ?? [];
  }

  /** Put up a file, with direct light alone until `compile` has run. */
  put(asset: LoadedAsset, weights: WeightPlacement | null): LearnedScene {
    this.clear();
    const { renderer, scene } = this;
    const learned = new LearnedScene(asset.gltf, weights ? { renderer, weights } : { renderer });
    learned.useFields(false);
    this.learned = learned;
    scene.add(learned.root);
    this.surroundings = new Surroundings(scene, learned);
    this.object = learned.hasProbes ? new TestObject(learned.core) : null;
    scene.background = this.surroundings.sky?.texture ?? null;
    return learned;
  }

  /** Light the test object, where there is one. */
  async lightObject(): Promise<void> {
    if (this.learned) await this.object?.light(this.learned);
  }

  /** Give every point lamp a visible body. */
  embody(): void {
    this.surroundings?.embody();
  }

  /** Draw into a target. */
  render(target: WebGLRenderTarget, camera: PerspectiveCamera): void {
    this.renderer.setRenderTarget(target);
    this.renderer.clear();
    this.learned?.render(this.renderer, this.scene, camera, target.width, target.height);
    this.renderer.setRenderTarget(null);
  }

  /** Draw into a target, with ordinary light maps in place of the learned light. */
  renderLightmap(target: WebGLRenderTarget, camera: PerspectiveCamera): void {
    this.renderer.setRenderTarget(target);
    this.renderer.clear();
    this.learned?.renderLightmap(this.renderer, this.scene, camera);
    this.renderer.setRenderTarget(null);
  }

  /** Compile a look for the target that it is drawn into, on which shaders depend. */
  async compile(target: WebGLRenderTarget, camera: PerspectiveCamera, look: Look): Promise<void> {
    this.renderer.setRenderTarget(target);
    const compiled = this.learned?.compile(this.renderer, this.scene, camera, look);
    this.renderer.setRenderTarget(null);
    await compiled;
  }

  /** Bring everything up to date before a frame. */
  prepare(parts: Parts, exposure: number, glowing: boolean): void {
    this.learned?.show(parts);
    this.learned?.update();
    this.surroundings?.update(exposure, glowing, parts.still);
    if (this.object) this.object.mesh.visible = glowing && this.object.shown;
  }

  /** Intensity and colour as they were baked: the references were traced with them. */
  resetLamps(): void {
    for (const lamp of this.learned?.switches ?? []) lamp.reset();
    for (const lamp of this.lamps) {
      lamp.intensity = lamp.variable.intensity;
      lamp.color.setRGB(...(lamp.variable.color as [number, number, number]));
    }
  }

  clear(): void {
    this.surroundings?.dispose();
    this.surroundings = null;
    this.object?.dispose();
    this.object = null;
    this.learned?.dispose();
    this.learned = null;
    this.scene.background = null;
    this.scene.clear();
  }
}
