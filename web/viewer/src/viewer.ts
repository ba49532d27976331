/** The viewer without its controls: what is loaded, what is shown, and when a frame is drawn. */

import { type FieldProgram, type Lamp, type LearnedScene, rendererName } from "lightwell";
import { Box3, type Color, type DataTexture, Vector3, type WebGLRenderer } from "three";
import type { LoadedAsset } from "./asset.ts";
import { CameraRig, overview } from "./camera-rig.ts";
import type { Comparison } from "./comparison.ts";
import { Emitter } from "./emitter.ts";
import type { ViewerEvents } from "./events.ts";
import { FrameTimer } from "./frame-timer.ts";
import { type Mode, needsReference } from "./modes.ts";
import type { Options } from "./options.ts";
import { SHOW } from "./output-shader.ts";
import { EMPTY_PAGE, type PageData } from "./page-data.ts";
import { Pipeline } from "./pipeline.ts";
import { meterExposure, type Picture, readCanvas, readTarget, timeFrames } from "./readback.ts";
import { RenderScale } from "./render-scale.ts";
import { createRenderer, onContextLoss, onShaderError, seen } from "./renderer.ts";
import { Stage } from "./stage.ts";
import type { ToneMappingName } from "./tone-mapping.ts";
import { calmExposure, nearestReference, Truth } from "./truth.ts";

/** More pixels than this per CSS pixel are not worth their cost. */
const MAX_PIXEL_RATIO = 2;
const CONTEXT_LOST =
  "The graphics context was lost. It usually comes back by itself; reload the page if not.";

/** Owns renderer, camera, scene and state. Change the state through its methods alone. */
export class Viewer extends Emitter<ViewerEvents> {
  readonly canvas: HTMLCanvasElement;
  readonly renderer: WebGLRenderer;
  readonly rig: CameraRig;
  readonly options: Options;
  page: PageData = EMPTY_PAGE;
  title = "";
  mode: Mode = "learned";
  /** The saved view that camera and light agree with; null after they moved. */
  view: number | null = null;
  toneMapping: ToneMappingName = "agx";
  /** Stops on top of the page's exposure. */
  stops = 0;
  /** Whether the learned light of the scene's own emitters is on. */
  stillLight = true;
  /** Where the reference ends in split mode, 0 … 1 from the left. */
  split = 0.5;
  /** Whether the shaders of the learned light are still being compiled: only direct light is shown. */
  preparing = false;
  /** Whether the learned light is evaluated at half resolution. */
  half: boolean;
  /** Exposure of the scene, and that of the view that was chosen last. */
  private sceneExposure = 1;
  private baseExposure = 1;
  private readonly pipeline: Pipeline;
  private readonly timer: FrameTimer;
  private readonly scale: RenderScale;
  private readonly stage: Stage;
  private readonly truth: Truth;
  private requested = 0;
  /** Counts compilations; the last one ends `preparing`. */
  private compilations = 0;
  private userMoved = false;
  private shaderError = "";
  private readonly resizeObserver: ResizeObserver;

  constructor(canvas: HTMLCanvasElement, options: Options) {
    super();
    this.canvas = canvas;
    this.options = options;
    this.half = options.half;
    this.renderer = createRenderer(canvas);
    this.pipeline = new Pipeline(this.renderer, options.samples);
    this.stage = new Stage(this.renderer);
    this.truth = new Truth(this.renderer, this.pipeline);
    this.timer = new FrameTimer(this.renderer.getContext() as WebGL2RenderingContext);
    this.rig = new CameraRig(canvas);
    this.scale = new RenderScale(options.size === null, () => this.invalidate());
    this.pipeline.uniforms.dither.value = options.dither ? 1 : 0;
    this.setToneMapping(options.toneMapping ?? "agx");
    this.listen();
    this.resizeObserver = new ResizeObserver(() => this.resize());
    this.resizeObserver.observe(canvas);
    this.resize();
  }

  /** Linear factor before tone mapping. */
  get exposure(): number {
    return this.baseExposure * 2 ** this.stops;
  }

  get learned(): LearnedScene | null {
    return this.stage.learned;
  }

  get lamps(): readonly Lamp[] {
    return this.stage.lamps;
  }

  /** Whether the learned light has parts that can be shown. */
  get hasExperts(): boolean {
    return this.learned?.hasSegments ?? false;
  }

  get fields(): readonly FieldProgram[] {
    return this.learned?.fields ?? [];
  }

  /** Errors against the reference of the saved view that is shown; null while unknown. */
  get comparison(): Comparison | null {
    return this.preparing ? null : this.truth.comparison;
  }

  /** Name that the driver gives itself. */
  get rendererName(): string {
    return rendererName(this.renderer.getContext());
  }

  /** Whether any saved view has a path-traced picture. */
  get hasReferences(): boolean {
    return this.page.views.some((view) => view.reference !== "");
  }

  /** Median milliseconds per frame; null before one is known. */
  get frameMilliseconds(): number | null {
    return this.timer.milliseconds;
  }

  /**
   * Show a loaded asset: with direct light at first, which `loaded` tells of, then with all of it. Resolves when the
   * shaders of the learned light are compiled and it is drawn.
   */
  async load(asset: LoadedAsset): Promise<void> {
    this.unload();
    this.page = asset.page;
    this.title = asset.page.title || asset.name || asset.gltf.scene.name || "Untitled scene";
    const learned = this.stage.put(asset, this.options.weights);
    this.rig.fit(learned.bounds);
    this.goHome();
    if (!learned.hasIndirectLight && !learned.hasStillLight) {
      this.emit("notice", "This file carries no learned light; it is shown with direct light alone.");
    }
    const exposure = this.options.exposure ?? asset.page.exposure ?? null;
    this.preparing = true;
    this.meter(exposure);
    this.renderOnce();
    this.emit("loaded", undefined);
    this.emit("lamps", undefined);
    this.changed();
    await seen();
    if (this.learned === learned) await this.compile();
    if (this.learned !== learned) return;
    if (exposure === null) this.meter(exposure);
    this.renderOnce();
    // The first frame carried the upload of everything; the second says what a frame costs.
    if (this.options.ui) this.measure(1);
    this.changed();
  }

  /** Resolves when nothing is being compiled. */
  async prepared(): Promise<void> {
    while (this.preparing)
      await new Promise<void>((resolve) => {
        const stop = this.on("change", () => {
          stop();
          resolve();
        });
      });
  }

  /** Draw a frame soon. */
  invalidate(): void {
    if (this.requested === 0) this.requested = requestAnimationFrame((now) => this.animate(now));
  }

  /** Draw a frame now. */
  renderOnce = (): void => this.draw(1);

  setMode(mode: Mode): void {
    if (mode === "experts" && !this.hasExperts) {
      this.say("The learned light of this file has no parts to tell apart.");
      return;
    }
    if (needsReference(mode)) {
      if (!this.hasReferences) {
        this.say("This file carries no path-traced pictures to compare with.");
        return;
      }
      if (this.view === null || !this.page.views[this.view]?.reference) {
        this.setView(nearestReference(this.page.views, this.rig.camera.position));
      }
      this.resetLight();
    }
    const [before, after] = [this.mode, mode].map((name) => name === "experts");
    this.mode = mode;
    if (before !== after) void this.compile();
    this.changed();
  }

  /** Go to a saved view: its camera and its light. */
  setView(index: number): void {
    const view = this.page.views[index];
    if (!view) return;
    if (needsReference(this.mode) && !view.reference) this.mode = "learned";
    this.place(() => this.rig.place(view.camera, view.width / view.height));
    this.resetLight();
    const lamp = this.lamps[0];
    if (lamp && view.light) lamp.move(new Vector3(...view.light));
    this.view = index;
    this.truth.comparison = null;
    this.baseExposure = this.sceneExposure;
    if (view.reference)
      void this.reference(index).then(
        (picture) => this.adapt(index, picture),
        () => {},
      );
    this.changed();
  }

  /** Camera and lights as they were baked. */
  goHome(): void {
    const { home, views } = this.page;
    const camera = home ?? views[0]?.camera ?? overview(this.learned?.bounds ?? new Box3());
    this.leaveView();
    this.place(() => this.rig.place(camera, 1));
    this.resetLight();
    for (const lamp of this.lamps) lamp.move(new Vector3(...lamp.variable.initial));
    this.baseExposure = this.sceneExposure;
    this.changed();
  }

  /** Look from a point at another. */
  setCamera(position: readonly number[], target: readonly number[], fovY = 45): void {
    this.leaveView();
    const [p, t] = [position as [number, number, number], target as [number, number, number]];
    this.place(() => this.rig.place({ position: p, target: t, up: [0, 1, 0], fovY }, 1e-3));
    this.changed();
  }

  /** Move a lamp; returns whether the wish was clamped to what was learned. */
  setLight(index: number, value: Vector3): boolean {
    const clamped = this.lamps[index]?.move(value) ?? false;
    this.relit();
    return clamped;
  }

  setIntensity(index: number, intensity: number): void {
    const lamp = this.lamps[index];
    if (!lamp) return;
    lamp.intensity = intensity;
    this.relit();
  }

  setColor(index: number, color: Color): void {
    this.lamps[index]?.color.copy(color);
    this.relit();
  }

  /** Whether a lamp was added to those of the file. */
  isAdded(index: number): boolean {
    return index >= (this.learned?.variables.length ?? 0);
  }

  /** Add a lamp of the kind of a declared light; returns its number, or -1 when there are enough. */
  addLamp(variable = 0): number {
    if (!this.learned?.addLamp(variable)) {
      this.say(this.lamps.length ? "There is no room for another lamp." : "This file has no lamp that can move.");
      return -1;
    }
    this.leaveView();
    this.relamped();
    return this.lamps.length - 1;
  }

  /** Take the lamp of this number away, if it was added. */
  removeLamp(index: number): void {
    if (!this.learned?.removeLamp(index)) return;
    this.leaveView();
    this.relamped();
  }

  /** Evaluate the learned light at half resolution, or at full. */
  setHalf(on: boolean): void {
    if (this.half === on) return;
    this.half = on;
    this.truth.comparison = null;
    void this.compile();
    this.changed();
  }

  setStops(stops: number): void {
    this.stops = stops;
    this.changed();
  }

  setToneMapping(name: ToneMappingName): void {
    this.toneMapping = name;
    this.pipeline.setToneMapping(name);
    this.changed();
  }

  setStillLight(on: boolean): void {
    this.stillLight = on;
    this.leaveView();
    this.changed();
  }

  setSplit(split: number): void {
    this.split = Math.min(1, Math.max(0, split));
    this.changed();
  }

  say(message: string): void {
    this.emit("notice", message);
  }

  /** The path-traced picture of a view, decoded once. */
  reference(index: number): Promise<DataTexture> {
    return this.truth.picture(index, this.page.views[index]!, (error) => {
      if (error) this.emit("trouble", `View ${index + 1}: ${error.message}`);
      else this.changed();
    });
  }

  /** Draw the picture of a view, small, for a thumbnail: its reference when it has one. */
  async thumbnail(index: number, width: number, height: number): Promise<ImageData | null> {
    const view = this.page.views[index];
    if (!view?.reference) return null;
    const texture = await this.reference(index);
    return this.pipeline.thumbnail(texture, width, height, this.exposure);
  }

  /** Median milliseconds over some frames that are drawn and waited for. */
  measure(frames = 5): number {
    const median = timeFrames(this.renderer, frames, this.renderOnce);
    this.timer.add(median);
    this.changed();
    return median;
  }

  /** The canvas as RGBA bytes, first row at the top. */
  readPixels(): Picture<Uint8Array> {
    this.renderOnce();
    return readCanvas(this.renderer);
  }

  /** The learned picture as linear RGBA radiance, first row at the top. */
  readRadiance(): Picture<Float32Array> {
    this.renderOnce();
    return readTarget(this.renderer, this.pipeline.total);
  }

  dispose(): void {
    cancelAnimationFrame(this.requested);
    this.resizeObserver.disconnect();
    this.unload();
    this.timer.dispose();
    this.scale.dispose();
    this.pipeline.dispose();
    this.rig.dispose();
    this.renderer.dispose();
  }

  private listen(): void {
    const { controls } = this.rig;
    controls.addEventListener("start", () => {
      this.userMoved = true;
    });
    controls.addEventListener("change", () => {
      if (!this.userMoved) return;
      this.scale.touch();
      if (this.view !== null) {
        this.leaveView();
        this.changed();
      }
      this.invalidate();
    });
    onContextLoss(this.canvas, (lost) => {
      if (!lost) for (const lamp of this.lamps) lamp.move(lamp.value.clone());
      this.emit("trouble", lost ? CONTEXT_LOST : "");
      this.invalidate();
    });
    onShaderError(this.renderer, (log) => {
      this.shaderError = log;
    });
  }

  /** Take the scene's exposure from the page, or from what is shown. */
  private meter(exposure: number | null): void {
    this.sceneExposure = exposure ?? meterExposure(this.readRadiance());
    this.baseExposure = this.sceneExposure;
  }

  /** Stop down where a lamp is so near that the picture of a view would be washed out. */
  private adapt(index: number, picture: DataTexture): void {
    if (this.view !== index || this.options.exposure !== null) return;
    this.baseExposure = Math.min(this.sceneExposure, calmExposure(picture));
    this.changed();
  }

  /** Put the camera somewhere without taking it for the user's doing. */
  private place(move: () => void): void {
    this.userMoved = false;
    move();
  }

  /** Camera or light no longer agree with a saved view: its reference no longer says anything. */
  private leaveView(): void {
    this.view = null;
    this.truth.comparison = null;
    if (!needsReference(this.mode)) return;
    this.mode = "learned";
    this.say("Path-traced pictures exist for the saved views alone. Back to learned light.");
  }

  /** The light of the bake: its lamps alone, as they were. */
  private resetLight(): void {
    const { learned } = this;
    const declared = learned?.variables.length ?? 0;
    if (this.lamps.length > declared) {
      while (this.lamps.length > declared) learned?.removeLamp(this.lamps.length - 1);
      this.relamped();
    }
    this.stage.resetLamps();
    this.stillLight = true;
  }

  /** There are other lamps than before, for which shaders must be compiled. */
  private relamped(): void {
    this.stage.embody();
    this.emit("lamps", undefined);
    void this.compile();
    this.changed();
  }

  /** Compile what is to be shown; until then it is as before, or without the learned light. */
  private async compile(): Promise<void> {
    const { learned } = this;
    const look = { half: this.half, segments: this.mode === "experts" };
    const compilation = ++this.compilations;
    this.preparing = true;
    await this.stage.compile(this.pipeline.total, this.rig.camera, look);
    if (this.learned !== learned || compilation !== this.compilations) return;
    this.preparing = false;
    this.truth.comparison = null;
    this.changed();
  }

  private relit(): void {
    this.leaveView();
    this.scale.touch();
    this.changed();
  }

  private changed(): void {
    this.emit("change", undefined);
    this.invalidate();
  }

  private resize(): void {
    const [width, height] = this.options.size ?? [
      this.canvas.clientWidth || 1,
      this.canvas.clientHeight || 1,
    ];
    this.renderer.setPixelRatio(this.options.size ? 1 : Math.min(devicePixelRatio, MAX_PIXEL_RATIO));
    this.renderer.setSize(width, height, false);
    this.rig.project(width / height);
    this.renderOnce();
    this.emit("change", undefined);
  }

  private animate(now: number): void {
    this.requested = 0;
    const gliding = this.rig.controls.update();
    this.timer.begin();
    this.draw(this.scale.factor(now));
    this.timer.end(now);
    if (gliding) this.invalidate();
  }

  private draw(scale: number): void {
    if (!this.learned || this.renderer.getContext().isContextLost()) return;
    this.prepare();
    const { width, height } = this.canvas;
    const { pipeline, rig } = this;
    pipeline.renderStage(pipeline.total, width * scale, height * scale, this.stage, rig.camera);
    if (this.shaderError) {
      this.recover();
      return;
    }
    this.drawComparison();
    pipeline.present();
    this.emit("frame", undefined);
  }

  /** Set everything that a frame depends on. */
  private prepare(): void {
    const { mode } = this;
    const still = this.stillLight && mode !== "direct";
    const parts = { raster: mode !== "indirect", indirect: mode !== "direct", still };
    const glowing = this.options.ui && !needsReference(mode) && mode !== "experts";
    this.stage.prepare(parts, this.exposure, glowing);
    this.pipeline.uniforms.toneMappingExposure.value = this.exposure;
  }

  /** Set up reference and difference, once the reference is decoded. */
  private drawComparison(): void {
    const { truth, view: index, mode, split, rig, stage } = this;
    if (!truth.has(index) || !needsReference(mode)) {
      const segments = stage.learned?.showsSegments ?? false;
      this.pipeline.uniforms.show.value = segments ? SHOW.experts : SHOW.learned;
      return;
    }
    // A picture that lacks the learned light says nothing about it.
    if (this.preparing) truth.comparison = null;
    const isNew = truth.draw({ index, view: this.page.views[index]!, mode, split, stage, rig });
    if (isNew && !this.preparing) this.emit("change", undefined);
  }

  /** A field's shader did not compile: show what can be shown. */
  private recover(): void {
    console.warn("lightwell: a shader failed to compile:", this.shaderError);
    this.shaderError = "";
    if (this.fields.length === 0) return;
    this.learned?.useFields(false);
    this.emit("trouble", "This browser could not compile the learned light; only direct light is shown.");
    this.invalidate();
  }

  private unload(): void {
    this.truth.clear();
    this.stage.clear();
    this.view = null;
    this.preparing = false;
    this.mode = "learned";
  }
}
