/** Draws frames: what the viewer holds, and when and how it is put onto the canvas. */

import { type FieldProgram, FormatError, type Lamp, type LearnedScene, rendererName } from "lightwell";
import type { DataTexture, WebGLRenderer } from "three";
import { onPixelRatio } from "../../runtime/src/pixel-ratio.ts";
import { CameraRig } from "./camera-rig.ts";
import type { LoadedAsset } from "./asset.ts";
import type { Comparison } from "./comparison.ts";
import { Emitter } from "./emitter.ts";
import type { ViewerEvents } from "./events.ts";
import { Exposure } from "./exposure.ts";
import { LensController, type LensHost } from "./lens-controller.ts";
import { type Against, canShow, type Mode } from "./modes.ts";
import type { Options } from "./options.ts";
import { EMPTY_PAGE, type PageData } from "./page-data.ts";
import { needsReference, Presenter, type Shown } from "./presenter.ts";
import { type Picture, readShown } from "./readback.ts";
import { Refinement } from "./refinement.ts";
import { RenderScale } from "./render-scale.ts";
import { createRenderer, onShaderError } from "./renderer.ts";
import { Stage } from "./stage.ts";
import type { ToneMappingName } from "./tone-mapping.ts";

/** More pixels than this per CSS pixel are not worth their cost. */
const MAX_PIXEL_RATIO = 2;

/** Owns renderer, camera, scene and what is shown; `Viewer` changes it. */
export abstract class ViewerFrames extends Emitter<ViewerEvents> {
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
  /** Whether the learned light of the scene's own emitters is on. */
  stillLight = true;
  /** Where the left picture ends in split mode, 0 … 1; and what it is. */
  split = 0.5;
  against: Against = "direct";
  /** Whether the shaders of the learned light are still being compiled: only direct light is shown. */
  preparing = false;
  /** Whether the learned light is evaluated at half resolution. */
  half: boolean;
  /** What the user does with the lens. */
  readonly lens: LensController;
  /** Size of the file that is shown. */
  fileBytes = 0;
  /** The file that is shown. */
  protected asset: LoadedAsset | null = null;
  protected readonly exposed: Exposure;
  protected readonly presenter: Presenter;
  protected readonly scale: RenderScale;
  private readonly refinement: Refinement;
  protected readonly stage: Stage;
  private requested = 0;
  /** Counts compilations; the last one ends `preparing`. */
  private compilations = 0;
  private readonly resizeObserver: ResizeObserver;
  /** Ends what hears of another pixel ratio. */
  private readonly unheard: () => void;

  constructor(canvas: HTMLCanvasElement, options: Options) {
    super();
    this.canvas = canvas;
    this.options = options;
    this.half = options.half;
    this.renderer = createRenderer(canvas);
    this.exposed = new Exposure(options.exposure);
    this.stage = new Stage(this.renderer);
    this.rig = new CameraRig(canvas);
    this.presenter = new Presenter(this.renderer, this.stage, this.rig, options);
    this.lens = new LensController(this.lensHost());
    this.refinement = new Refinement((index) => {
      if (!this.renderer.getContext().isContextLost()) this.presenter.refine(this.shown(), index);
    });
    this.scale = new RenderScale(options.size === null, () => this.invalidate());
    onShaderError(this.renderer, (log) => {
      this.presenter.shaderError = log;
    });
    this.resizeObserver = new ResizeObserver(() => this.resize());
    this.resizeObserver.observe(canvas);
    this.unheard = onPixelRatio(() => this.resize());
    this.resize();
  }

  /** Linear factor before tone mapping. */
  get exposure(): number {
    return this.exposed.value;
  }

  /** Stops on top of the page's exposure. */
  get stops(): number {
    return this.exposed.stops;
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
    return this.preparing ? null : this.presenter.references.comparison;
  }

  /** Name that the driver gives itself. */
  get rendererName(): string {
    return rendererName(this.renderer.getContext());
  }

  /** Whether any saved view has a path-traced picture. */
  get hasReferences(): boolean {
    return this.page.views.some((view) => view.reference !== "");
  }

  /** Whether the file carries ordinary light maps too. */
  get hasLightmaps(): boolean {
    return this.learned?.hasLightmaps ?? false;
  }

  /** Whether a mode has anything to show. */
  offers(mode: Mode): boolean {
    return canShow(mode, this);
  }

  /** Median milliseconds per frame; null before one is known. */
  get frameMilliseconds(): number | null {
    return this.presenter.timer.milliseconds;
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
    this.refinement.stop();
    if (this.requested === 0) this.requested = requestAnimationFrame((now) => this.animate(now));
  }

  /** The canvas that is seen: the page's own, or that of the lens above it. */
  get shownCanvas(): HTMLCanvasElement {
    return this.lens.canvas ?? this.canvas;
  }

  /** Draw a frame now. */
  renderOnce = (): void => {
    // The first frame of the lens shows when it is done.
    if (!this.drawLens(true) || !this.lens.canvas) this.draw(1);
  };

  /** Draw the picture with smooth edges now, as it is shown once nothing has changed for a while. */
  renderSmooth(): void {
    this.renderOnce();
    if (!this.refinable) return;
    this.refinement.begin();
    this.refinement.finish();
  }

  /** Whether the picture that is shown has its smooth edges, if it can have any. */
  get rests(): boolean {
    return this.requested === 0 && this.refinement.rests;
  }

  /** Whether the file has a picture for the left in split mode. */
  canHold(against: Against): boolean {
    return against === "direct" || (against === "reference" ? this.hasReferences : this.hasLightmaps);
  }

  say(message: string): void {
    this.emit("notice", message);
  }

  /** The path-traced picture of a view, decoded once. */
  reference(index: number): Promise<DataTexture> {
    return this.presenter.references.picture(index, this.page.views[index]!, (error) => {
      if (error) this.emit("trouble", `View ${index + 1}: ${error.message}`);
      else this.changed();
    });
  }

  /** Draw the picture of a view, small, for a thumbnail: its reference when it has one. */
  async thumbnail(index: number, width: number, height: number): Promise<ImageData | null> {
    const view = this.page.views[index];
    if (!view?.reference) return null;
    const texture = await this.reference(index);
    return this.presenter.pipeline.thumbnail(texture, width, height, this.exposure);
  }

  /** Median milliseconds over some frames without the lens that are drawn and waited for. */
  measure(frames = 5): number {
    const median = this.presenter.time(frames, () => this.draw(1));
    this.changed();
    return median;
  }

  /** The canvas as RGBA bytes, first row at the top. */
  readPixels(): Picture<Uint8Array> {
    this.renderOnce();
    return this.lens.canvas ? readShown(this.lens.canvas) : this.presenter.readPixels();
  }

  /** The learned picture as linear RGBA radiance, without the lens, first row at the top. */
  readRadiance(): Picture<Float32Array> {
    this.draw(1);
    return this.presenter.readRadiance();
  }

  dispose(): void {
    cancelAnimationFrame(this.requested);
    this.refinement.stop();
    this.resizeObserver.disconnect();
    this.unheard();
    this.presenter.references.clear();
    this.stage.clear();
    this.lens.dispose();
    this.scale.dispose();
    this.presenter.dispose();
    this.rig.dispose();
    this.renderer.dispose();
  }

  /** Compile what is to be shown; until then it is as before, or without the learned light. */
  protected async compile(): Promise<void> {
    const { learned } = this;
    const look = { half: this.half, segments: this.mode === "experts" };
    const compilation = ++this.compilations;
    this.preparing = true;
    try {
      await this.stage.compile(this.presenter.pipeline.total, this.rig.camera, look);
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
      // More than the device offers: direct light alone is drawn.
      this.say(error.message);
    }
    if (this.learned !== learned || compilation !== this.compilations) return;
    this.preparing = false;
    this.presenter.references.comparison = null;
    this.changed();
  }

  protected changed(): void {
    this.emit("change", undefined);
    this.invalidate();
  }

  /** What the lens needs of the viewer. */
  private lensHost(): LensHost {
    const viewer = this;
    const { canvas, options, stage, rig } = this;
    return {
      ...{ canvas, options, stage, camera: rig.camera },
      get toneMapping() {
        return viewer.toneMapping;
      },
      get asset() {
        return viewer.asset;
      },
      changed: () => this.changed(),
      say: (message) => this.say(message),
      timed: (milliseconds) => this.presenter.timer.add(milliseconds),
    };
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
    const scale = this.scale.factor(now);
    if (!this.drawLens(false)) {
      this.presenter.timer.begin();
      this.draw(scale);
      this.presenter.timer.end(now);
    }
    if (gliding) this.invalidate();
    else if (scale === 1 && this.refinable) this.refinement.begin();
  }

  /** Whether the picture that was drawn last has edges of its own that more samples make smooth. */
  private get refinable(): boolean {
    const { learned, lens, preparing } = this;
    return learned !== null && lens.canvas === null && !preparing && !needsReference(this);
  }

  /** Draw a frame through the lens, if that is what is shown. */
  private drawLens(now: boolean): boolean {
    if (!this.learned || !this.lens.draw(this.shown(), now)) return false;
    this.emit("frame", undefined);
    return true;
  }

  /** What a frame depends on. */
  private shown(): Shown {
    const { mode, against, split, stillLight, exposure, preparing, view: index } = this;
    const view = index === null ? null : { index, data: this.page.views[index]! };
    const glowing = this.options.ui && !needsReference(this) && mode !== "experts";
    return { mode, against, split, view, exposure, stillLight, glowing, preparing };
  }

  /** Draw a frame onto the page's own canvas. */
  private draw(scale: number): void {
    this.refinement.stop();
    if (!this.learned || this.renderer.getContext().isContextLost()) return;
    const { ok, isNew } = this.presenter.draw(this.shown(), scale);
    if (!ok) return this.recover();
    if (isNew) this.emit("change", undefined);
    this.emit("frame", undefined);
  }

  /** A field's shader did not compile: show what can be shown. */
  private recover(): void {
    console.warn("lightwell: a shader failed to compile:", this.presenter.shaderError);
    this.presenter.shaderError = "";
    if (this.fields.length === 0) return;
    this.learned?.useFields(false);
    this.emit("trouble", "This browser could not compile the learned light; only direct light is shown.");
    this.invalidate();
  }
}
