/** The viewer without its controls: what is loaded, what is shown, and when a frame is drawn. */

import { type FieldProgram, FormatError, type Lamp, type LearnedScene, rendererName } from "lightwell";
import { Box3, type DataTexture, Vector3, type WebGLRenderer } from "three";
import type { LoadedAsset } from "./asset.ts";
import { CameraRig, overview } from "./camera-rig.ts";
import type { Comparison } from "./comparison.ts";
import { Darkroom } from "./darkroom.ts";
import { Emitter } from "./emitter.ts";
import type { ViewerEvents } from "./events.ts";
import { Exposure } from "./exposure.ts";
import { LampDesk, type LampState } from "./lamp-desk.ts";
import { LensDesk, type LensHost } from "./lens-desk.ts";
import { AGAINST, type Against, canShow, type Mode, whyNot } from "./modes.ts";
import type { Options } from "./options.ts";
import { EMPTY_PAGE, type PageData } from "./page-data.ts";
import { needsReference, Presenter } from "./presenter.ts";
import type { Picture } from "./readback.ts";
import { RenderScale } from "./render-scale.ts";
import { createRenderer, onContextLoss, onShaderError, seen } from "./renderer.ts";
import { Stage } from "./stage.ts";
import type { ToneMappingName } from "./tone-mapping.ts";
import { nearestReference } from "./truth.ts";

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
  /** Whether the learned light of the scene's own emitters is on. */
  stillLight = true;
  /** Where the left picture ends in split mode, 0 … 1; and what it is. */
  split = 0.5;
  against: Against = "direct";
  /** Whether the shaders of the learned light are still being compiled: only direct light is shown. */
  preparing = false;
  /** Whether the learned light is evaluated at half resolution. */
  half: boolean;
  /** What the user does to the lamps. */
  readonly desk: LampDesk;
  /** What the user does with the lens. */
  readonly lens: LensDesk;
  /** Size of the file that is shown. */
  fileBytes = 0;
  private readonly exposed: Exposure;
  private readonly presenter: Presenter;
  private readonly scale: RenderScale;
  private readonly stage: Stage;
  private requested = 0;
  /** Counts compilations; the last one ends `preparing`. */
  private compilations = 0;
  private userMoved = false;
  /** The user's lamps while a reference, which has its own, is shown. */
  private parked: readonly LampState[] | null = null;
  private readonly resizeObserver: ResizeObserver;

  constructor(canvas: HTMLCanvasElement, options: Options) {
    super();
    this.canvas = canvas;
    this.options = options;
    this.half = options.half;
    this.renderer = createRenderer(canvas);
    this.exposed = new Exposure(options.exposure);
    this.stage = new Stage(this.renderer);
    this.desk = new LampDesk(this.stage, {
      relit: () => this.relit(),
      relamped: () => this.relamped(),
      say: (message) => this.say(message),
    });
    this.rig = new CameraRig(canvas);
    this.presenter = new Presenter(this.renderer, this.stage, this.rig, options);
    this.lens = new LensDesk(this.lensHost());
    this.scale = new RenderScale(options.size === null, () => this.invalidate());
    this.setToneMapping(options.toneMapping ?? "agx");
    this.listen();
    this.resizeObserver = new ResizeObserver(() => this.resize());
    this.resizeObserver.observe(canvas);
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
    return this.preparing ? null : this.presenter.truth.comparison;
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

  /**
   * Show a loaded asset: with direct light at first, which `loaded` tells of, then with all of it. Resolves when the
   * shaders of the learned light are compiled and it is drawn.
   */
  async load(asset: LoadedAsset): Promise<void> {
    this.unload();
    this.page = asset.page;
    this.title = asset.page.title || asset.name || asset.gltf.scene.name || "Untitled scene";
    this.fileBytes = asset.bytes;
    const learned = this.stage.put(asset, this.options.weights);
    this.against = this.options.against ?? "direct";
    this.rig.fit(learned.bounds);
    this.goHome();
    if (!learned.hasIndirectLight && !learned.hasStillLight) {
      this.emit("notice", "This file carries no learned light; it is shown with direct light alone.");
    }
    const meter = () => this.exposed.meter(asset.page.exposure, () => this.readRadiance());
    this.preparing = true;
    const metered = meter();
    this.renderOnce();
    this.emit("loaded", undefined);
    this.emit("lamps", undefined);
    this.changed();
    await seen();
    if (this.learned === learned) await this.compile();
    if (this.learned !== learned) return;
    if (metered) meter();
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
    if (!this.offers(mode)) {
      this.say(whyNot(mode));
      return;
    }
    if (mode === "split" && !this.canHold(this.against)) this.against = "direct";
    const [needed, needs] = [needsReference(this), needsReference({ mode, against: this.against })];
    if (needed && !needs) this.returnLamps();
    if (needs) {
      if (!needed) this.parked = this.desk.states();
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
    if (needsReference(this) && !view.reference) this.mode = "learned";
    this.place(() => this.rig.place(view.camera, view.width / view.height));
    this.resetLight();
    const lamp = this.lamps[0];
    if (lamp && view.light) lamp.move(new Vector3(...view.light));
    this.view = index;
    this.presenter.truth.comparison = null;
    this.exposed.reset();
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
    this.exposed.reset();
    this.changed();
  }

  /** Look from a point at another. */
  setCamera(position: readonly number[], target: readonly number[], fovY = 45): void {
    this.leaveView();
    const [p, t] = [position as [number, number, number], target as [number, number, number]];
    this.place(() => this.rig.place({ position: p, target: t, up: [0, 1, 0], fovY }, 1e-3));
    this.changed();
  }

  /** Move the eye along its axes (right, up, ahead; shares of the scene's diagonal), and turn it by radians. */
  fly(step: readonly [number, number, number], turn: number): void {
    this.userMoved = true;
    this.rig.fly(step, turn);
    this.invalidate();
  }

  /** Evaluate the learned light at half resolution, or at full. */
  setHalf(on: boolean): void {
    if (this.half === on) return;
    this.half = on;
    this.presenter.truth.comparison = null;
    void this.compile();
    this.changed();
  }

  /** Choose the linear factor before tone mapping. */
  setExposure(value: number): void {
    this.exposed.choose(value);
    this.changed();
  }

  setStops(stops: number): void {
    this.exposed.stops = stops;
    this.changed();
  }

  setToneMapping(name: ToneMappingName): void {
    this.toneMapping = name;
    this.presenter.pipeline.setToneMapping(name);
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

  /** Choose what is to the left in split mode, if the file has it. */
  setAgainst(against: Against): void {
    if (!this.canHold(against)) return;
    if (needsReference(this) && against !== "reference") this.returnLamps();
    this.against = against;
    if (this.mode === "split") this.setMode("split");
    else this.changed();
  }

  /** Go on to the next picture that the file has for the left in split mode. */
  nextAgainst(): void {
    const offered = AGAINST.filter((against) => this.canHold(against));
    this.setAgainst(offered[(offered.indexOf(this.against) + 1) % offered.length]!);
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
    return this.presenter.truth.picture(index, this.page.views[index]!, (error) => {
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

  /** Median milliseconds over some frames that are drawn and waited for. */
  measure(frames = 5): number {
    const median = this.presenter.time(frames, this.renderOnce);
    this.changed();
    return median;
  }

  /** The canvas as RGBA bytes, first row at the top. */
  readPixels(): Picture<Uint8Array> {
    this.renderOnce();
    return this.presenter.readPixels();
  }

  /** The learned picture as linear RGBA radiance, first row at the top. */
  readRadiance(): Picture<Float32Array> {
    this.renderOnce();
    return this.presenter.readRadiance();
  }

  dispose(): void {
    cancelAnimationFrame(this.requested);
    this.resizeObserver.disconnect();
    this.unload();
    this.lens.dispose();
    this.scale.dispose();
    this.presenter.dispose();
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
      this.presenter.shaderError = log;
    });
  }

  /** What the lens needs of the viewer. */
  private lensHost(): LensHost {
    const viewer = this;
    const { renderer, presenter, stage, rig } = this;
    return {
      ...{ renderer, presenter, stage, camera: rig.camera },
      get mode() {
        return viewer.mode;
      },
      changed: () => this.changed(),
      say: (message) => this.say(message),
    };
  }

  /** Meter the picture of a view. */
  private adapt(index: number, picture: DataTexture): void {
    if (this.view !== index) return;
    this.exposed.adapt(picture);
    this.changed();
  }

  /** Put the camera somewhere without taking it for the user's doing. */
  private place(move: () => void): void {
    this.userMoved = false;
    move();
  }

  /** The lamps as the user left them before a reference was shown. */
  private returnLamps(): void {
    if (this.parked === null) return;
    this.desk.restore(this.parked);
    this.parked = null;
    this.view = null;
    this.presenter.truth.comparison = null;
  }

  /** Camera or light no longer agree with a saved view: its reference no longer says anything. */
  private leaveView(relit = false): void {
    this.view = null;
    this.presenter.truth.comparison = null;
    if (!needsReference(this)) return;
    this.mode = "learned";
    if (relit) this.parked = null;
    else this.returnLamps();
    this.say("Path-traced pictures exist for the saved views alone. Back to learned light.");
  }

  /** The light of the bake. */
  private resetLight(): void {
    this.desk.reset();
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
    try {
      await this.stage.compile(this.presenter.pipeline.total, this.rig.camera, look);
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
      // More than the device offers: direct light alone is drawn.
      this.say(error.message);
    }
    if (this.learned !== learned || compilation !== this.compilations) return;
    this.preparing = false;
    this.presenter.truth.comparison = null;
    this.changed();
  }

  private relit(): void {
    this.leaveView(true);
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
    this.presenter.timer.begin();
    this.draw(this.scale.factor(now));
    this.presenter.timer.end(now);
    if (gliding) this.invalidate();
  }

  private draw(scale: number): void {
    if (!this.learned || this.renderer.getContext().isContextLost()) return;
    const { mode, against, split, stillLight, exposure, preparing, view: index } = this;
    const view = index === null ? null : { index, data: this.page.views[index]! };
    const glowing = this.options.ui && !needsReference(this) && mode !== "experts";
    const developed = this.lens.active;
    if (developed) Darkroom.prepare(this.presenter.pipeline.total);
    const shown = { mode, against, split, view, exposure, stillLight, glowing, preparing, developed };
    const { ok, isNew } = this.presenter.draw(shown, scale);
    if (!ok) return this.recover();
    if (developed) void this.lens.develop();
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

  private unload(): void {
    this.presenter.truth.clear();
    this.stage.clear();
    this.view = null;
    this.parked = null;
    this.preparing = false;
    this.mode = "learned";
  }
}
