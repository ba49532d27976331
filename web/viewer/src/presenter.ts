/** Draws frames: the scene into a high-dynamic-range picture, what it is compared with, and both onto the canvas. */

import type { WebGLRenderer } from "three";
import type { CameraRig } from "./camera-rig.ts";
import { FrameTimer } from "./frame-timer.ts";
import type { Against, Mode } from "./modes.ts";
import type { Options } from "./options.ts";
import { SHOW } from "./output-shader.ts";
import type { ViewData } from "./page-data.ts";
import { Pipeline } from "./pipeline.ts";
import { type Picture, readCanvas, readTarget, timeFrames } from "./readback.ts";
import { shifted } from "./refinement.ts";
import type { Stage } from "./stage.ts";
import { ReferencePictures } from "./reference-pictures.ts";

/** Everything that a frame depends on. */
export interface Shown {
  readonly mode: Mode;
  /** What is to the left in split mode. */
  readonly against: Against;
  /** Where the left picture ends in split mode, 0 … 1. */
  readonly split: number;
  /** The saved view that camera and light agree with. */
  readonly view: { readonly index: number; readonly data: ViewData } | null;
  readonly exposure: number;
  readonly stillLight: boolean;
  /** Whether lamps have visible bodies. */
  readonly glowing: boolean;
  /** Whether the learned light is still being compiled. */
  readonly preparing: boolean;
}

/** Whether a frame needs the path-traced picture of a saved view. */
export function needsReference({ mode, against }: Pick<Shown, "mode" | "against">): boolean {
  return mode === "reference" || mode === "difference" || (mode === "split" && against === "reference");
}

/** Owns the render targets, the decoded references and the clock. */
export class Presenter {
  readonly pipeline: Pipeline;
  readonly references: ReferencePictures;
  readonly timer: FrameTimer;
  /** Log of a shader that did not compile; empty when all did. */
  shaderError = "";
  private readonly renderer: WebGLRenderer;
  private readonly stage: Stage;
  private readonly rig: CameraRig;

  constructor(renderer: WebGLRenderer, stage: Stage, rig: CameraRig, options: Options) {
    this.renderer = renderer;
    this.stage = stage;
    this.rig = rig;
    this.pipeline = new Pipeline(renderer, options.samples);
    this.pipeline.uniforms.dither.value = options.dither ? 1 : 0;
    this.references = new ReferencePictures(renderer, this.pipeline);
    this.timer = new FrameTimer(renderer.getContext() as WebGL2RenderingContext);
  }

  /** Draw a frame, at a share of the canvas' width and height; says whether the comparison is new. */
  draw(shown: Shown, scale: number): { readonly ok: boolean; readonly isNew: boolean } {
    const { width, height } = this.renderer.domElement;
    const [w, h] = [width * scale, height * scale];
    this.render(shown, w, h);
    if (this.shaderError) return { ok: false, isNew: false };
    const isNew = this.compare(shown);
    this.pipeline.present();
    return { ok: true, isNew };
  }

  /** Draw frame `index` ≥ 1 of a picture at rest, shifted by a part of a pixel, and show the mean of all; `draw` drew frame 0. */
  refine(shown: Shown, index: number): void {
    const { pipeline, rig, renderer } = this;
    const { width, height } = renderer.domElement;
    if (index === 1) pipeline.gather(1);
    const { autoUpdate } = renderer.shadowMap;
    // Shadows are as they were.
    renderer.shadowMap.autoUpdate = false;
    shifted(rig.camera, width, height, index, () => this.render(shown, width, height, pipeline.single));
    renderer.shadowMap.autoUpdate = autoUpdate;
    pipeline.gather(index + 1);
    pipeline.presentMean();
  }

  /** Draw what `shown` says into the targets, but for what the learned picture is compared with. */
  private render(shown: Shown, w: number, h: number, target = this.pipeline.total): void {
    const { pipeline, stage, rig } = this;
    if (shown.mode === "split" && shown.against === "direct") this.renderDirect(shown, w, h);
    const still = shown.stillLight && shown.mode !== "direct";
    const parts = { raster: shown.mode !== "indirect", indirect: shown.mode !== "direct", still };
    stage.prepare(parts, shown.exposure, shown.glowing);
    pipeline.uniforms.toneMappingExposure.value = shown.exposure;
    pipeline.uniforms.split.value = shown.split;
    if (shown.mode === "lightmap") pipeline.renderLightmap(target, w, h, stage, rig.camera);
    else pipeline.renderStage(target, w, h, stage, rig.camera);
    if (shown.mode === "split" && shown.against === "lightmap") pipeline.renderLightmap(pipeline.beside, w, h, stage, rig.camera);
  }

  /** The canvas as RGBA bytes, first row at the top. */
  readPixels(): Picture<Uint8Array> {
    return readCanvas(this.renderer);
  }

  /** The picture that was drawn last, as linear RGBA radiance, first row at the top. */
  readRadiance(): Picture<Float32Array> {
    return readTarget(this.renderer, this.pipeline.total);
  }

  /** Median milliseconds over some frames that `draw` draws and that are waited for. */
  time(frames: number, draw: () => void): number {
    const median = timeFrames(this.renderer, frames, draw);
    this.timer.add(median);
    return median;
  }

  dispose(): void {
    this.references.clear();
    this.timer.dispose();
    this.pipeline.dispose();
  }

  /** The scene under direct light alone, beside the learned picture. */
  private renderDirect({ exposure, glowing }: Shown, width: number, height: number): void {
    const { pipeline, stage, rig } = this;
    stage.prepare({ raster: true, indirect: false, still: false }, exposure, glowing);
    pipeline.renderStage(pipeline.beside, width, height, stage, rig.camera);
  }

  /** Set up what the learned picture is compared with; returns whether its errors are new. */
  private compare(shown: Shown): boolean {
    const { pipeline, references, stage, rig } = this;
    const { mode, view } = shown;
    pipeline.uniforms.show.value = stage.learned?.showsSegments ? SHOW.experts : SHOW.learned;
    if (mode === "split" && shown.against !== "reference") {
      pipeline.uniforms.show.value = SHOW.beside;
      return false;
    }
    if (view === null || !needsReference(shown) || !references.has(view.index)) return false;
    // A picture that lacks the learned light says nothing about it.
    if (shown.preparing) references.comparison = null;
    const isNew = references.draw({ index: view.index, view: view.data, mode, stage, rig });
    return isNew && !shown.preparing;
  }
}
