/** The page's scene for WebGPU: the same file once more, which follows what the page shows. */

import type { LearnedScene, Parts } from "lightwell";
import { LearnedNodeScene } from "lightwell/webgpu";
import { type PerspectiveCamera, Scene } from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import { equirectUV, texture } from "three/tsl";
import type { RenderTarget } from "three/webgpu";
import type { DeviceRenderer } from "./device-renderer.ts";
import { Surroundings } from "./surroundings.ts";

/** What is shown of the scene. */
export interface LensView {
  readonly parts: Parts;
  readonly exposure: number;
  /** Whether lamps have visible bodies. */
  readonly glowing: boolean;
  /** Whether ordinary light maps take the place of the learned light. */
  readonly lightmap: boolean;
}

/** Owns a scene graph of its own. */
export class LensStage {
  private readonly renderer: DeviceRenderer;
  private readonly scene = new Scene();
  private readonly learned: LearnedNodeScene;
  private readonly surroundings: Surroundings;

  constructor(gltf: GLTF, renderer: DeviceRenderer) {
    this.renderer = renderer;
    this.learned = new LearnedNodeScene(gltf, { renderer });
    this.scene.add(this.learned.root);
    this.surroundings = new Surroundings(this.scene, this.learned);
    const { sky } = this.surroundings;
    // A node reads the picture itself: three.js would make a cube map of it once, and the sky changes.
    if (sky) this.scene.backgroundNode = texture(sky.texture, equirectUV());
  }

  /** Whether the sky is behind everything. */
  get hasSky(): boolean {
    return this.surroundings.sky !== null;
  }

  /** Take over lamps and moved nodes; returns whether there are other lamps than before, for which shaders must be compiled. */
  follow(page: LearnedScene): boolean {
    const changed = this.followLampCount(page);
    for (const [i, lamp] of page.lamps.entries()) {
      const own = this.learned.lamps[i]!;
      if (!own.value.equals(lamp.value)) own.move(lamp.value);
      own.color.copy(lamp.color);
      own.intensity = lamp.intensity;
    }
    for (const [i, { intensity, color }] of page.switches.entries()) {
      const own = this.learned.switches[i]!;
      own.intensity = intensity;
      own.color.copy(color);
    }
    for (const [i, { value }] of page.movers.entries()) this.learned.movers[i]!.value = value;
    return changed;
  }

  /** Compile the shaders for the target that will be drawn into. */
  async compile(target: RenderTarget, camera: PerspectiveCamera, view: LensView): Promise<void> {
    this.prepare(view);
    const { renderer } = this;
    renderer.setRenderTarget(target);
    const compiled = this.learned.compile(renderer, this.scene, camera);
    renderer.setRenderTarget(null);
    await compiled;
  }

  /** Draw into a target. */
  render(target: RenderTarget, camera: PerspectiveCamera, view: LensView): void {
    this.prepare(view);
    const { renderer, scene } = this;
    renderer.setRenderTarget(target);
    if (view.lightmap) this.learned.renderLightmap(renderer, scene, camera);
    else renderer.render(scene, camera);
    renderer.setRenderTarget(null);
  }

  dispose(): void {
    this.surroundings.dispose();
    this.learned.dispose();
    this.scene.clear();
  }

  private prepare({ parts, exposure, glowing }: LensView): void {
    this.learned.show(parts);
    this.learned.update(this.renderer);
    this.surroundings.update(exposure, glowing, parts.still);
  }

  private followLampCount(page: LearnedScene): boolean {
    const { learned } = this;
    const kinds = ({ lamps, variables }: Pick<LearnedScene, "lamps" | "variables">) => lamps.map((lamp) => variables.indexOf(lamp.variable));
    const wanted = kinds(page);
    if (wanted.join() === kinds(learned).join()) return false;
    while (learned.removeLamp(learned.lamps.length - 1));
    for (const kind of wanted.slice(learned.lamps.length)) learned.addLamp(kind);
    this.surroundings.embody();
    return true;
  }
}
