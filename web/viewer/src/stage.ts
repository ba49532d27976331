/** What stands in the scene: the loaded file, its lamps, and their visible bodies. */

import { type Lamp, LearnedScene, type Look, type Parts, SkyBackground, sunsWithSky, type WeightPlacement } from "lightwell";
import {
  HemisphereLight,
  Light,
  type PerspectiveCamera,
  Scene,
  Vector3,
  type WebGLRenderer,
  type WebGLRenderTarget,
} from "three";
import type { LoadedAsset } from "./asset.ts";
import { LampGlow } from "./lamp-glow.ts";

/** Radius of the lamp's ball as a share of the scene's diagonal. */
const BALL_SHARE = 0.006;

/** Owns the scene graph. */
export class Stage {
  readonly scene = new Scene();
  learned: LearnedScene | null = null;
  private readonly renderer: WebGLRenderer;
  private glows: LampGlow[] = [];
  private sky: SkyBackground | null = null;

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
    if (isUnlit(learned)) scene.add(new HemisphereLight(0xffffff, 0x8d8478, 2.5));
    if (sunsWithSky(learned.lamps).length > 0) {
      this.sky = new SkyBackground();
      scene.background = this.sky.texture;
    }
    this.embody();
    return learned;
  }

  /** Give every point lamp a visible body. */
  embody(): void {
    for (const glow of this.glows) glow.dispose();
    const size = this.learned?.bounds.getSize(new Vector3()).length() ?? 0;
    this.glows = this.lamps
      .filter((lamp) => lamp.variable.kind === "point")
      .map((lamp) => new LampGlow(lamp, size * BALL_SHARE));
    for (const glow of this.glows) this.scene.add(glow.object);
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
    this.sky?.update(this.lamps);
    for (const glow of this.glows) glow.update(exposure, glowing);
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
    for (const glow of this.glows) glow.dispose();
    this.glows = [];
    this.learned?.dispose();
    this.learned = null;
    this.sky?.dispose();
    this.sky = null;
    this.scene.background = null;
    this.scene.clear();
  }
}

/** Whether nothing would light the scene. */
function isUnlit(learned: LearnedScene): boolean {
  let lights = learned.fields.length;
  learned.root.traverse((object) => {
    if (object instanceof Light) lights++;
  });
  return lights === 0;
}
