/** The viewer without its controls: what is loaded, and what is shown of it. */

import type { LampSetting } from "lightwell";
import { Box3, type DataTexture, Vector3 } from "three";
import type { LoadedAsset } from "./asset.ts";
import { overview } from "./camera-rig.ts";
import { LampController, type LampState } from "./lamp-controller.ts";
import { AGAINST, type Against, type Mode, whyNot } from "./modes.ts";
import type { Options } from "./options.ts";
import { needsReference } from "./presenter.ts";
import { onContextLoss, seen } from "./renderer.ts";
import type { TestObject } from "./test-object.ts";
import type { ToneMappingName } from "./tone-mapping.ts";
import { momentOf, nearestReference, otherMoment } from "./view-moment.ts";
import { ViewerFrames } from "./viewer-frames.ts";

const CONTEXT_LOST =
  "The graphics context was lost. It usually comes back by itself; reload the page if not.";

/** The light and the moving parts as a user left them. */
interface Parked {
  readonly lamps: readonly LampState[];
  /** Of the switches, in their order. */
  readonly settings: readonly LampSetting[];
  /** Of the movers, in their order. */
  readonly values: readonly number[];
  readonly stillLight: boolean;
}

/** Changes what is shown. Change it through these methods alone. */
export class Viewer extends ViewerFrames {
  /** What the user does to the lamps. */
  readonly lampController: LampController;
  private userMoved = false;
  /** The user's light and moving parts while a reference, which has its own, is shown. */
  private parked: Parked | null = null;

  constructor(canvas: HTMLCanvasElement, options: Options) {
    super(canvas, options);
    this.lampController = new LampController(this.stage, {
      relit: () => this.relit(),
      relamped: () => this.relamped(),
      say: (message) => this.say(message),
    });
    this.setToneMapping(options.toneMapping ?? "agx");
    this.listen();
  }

  /**
   * Show a loaded asset: with direct light at first, which `loaded` tells of, then with all of it. Resolves when the
   * shaders of the learned light are compiled and it is drawn.
   */
  async load(asset: LoadedAsset): Promise<void> {
    this.unload();
    this.asset = asset;
    this.page = asset.page;
    this.title = asset.page.title || asset.name || asset.gltf.scene.name || "Untitled scene";
    this.fileBytes = asset.bytes;
    const learned = this.stage.put(asset, this.options.weights);
    this.against = this.options.against ?? "direct";
    this.rig.fit(learned.core, learned.bounds);
    this.goHome();
    this.object?.meet(this.rig.camera.position, this.rig.controls.target);
    if (!learned.hasIndirectLight && !learned.hasStillLight) {
      this.emit("notice", "This file carries no learned light; it is shown with direct light alone.");
    }
    const meter = () => this.exposed.meter(asset.page.exposure ?? learned.exposure, () => this.readRadiance());
    this.preparing = true;
    const metered = meter();
    this.renderOnce();
    this.emit("loaded", undefined);
    this.emit("lamps", undefined);
    this.changed();
    await seen();
    if (this.learned === learned) await this.stage.lightObject();
    if (this.learned === learned) await this.compile();
    if (this.learned !== learned) return;
    if (metered) meter();
    this.renderOnce();
    // The first frame carried the upload of everything; the second says what a frame costs.
    if (this.options.ui) this.measure(1);
    this.changed();
  }

  /** What the probes of the file light; null where it has none. Call `touch` after a change. */
  get object(): TestObject | null {
    return this.stage.object;
  }

  /** Draw what was changed beside the scene. */
  touch(): void {
    this.scale.touch();
    this.changed();
  }

  setMode(mode: Mode): void {
    if (!this.offers(mode)) {
      this.say(whyNot(mode));
      return;
    }
    if (mode === "split" && !this.canHold(this.against)) this.against = "direct";
    const [needed, needs] = [needsReference(this), needsReference({ mode, against: this.against })];
    const moment = momentOf(this.lamps);
    if (needed && !needs) this.returnLight();
    if (needs) {
      if (!needed) this.parked = this.lightNow();
      if (this.view === null || !this.page.views[this.view]?.reference) {
        const nearest = nearestReference(this.page.views, this.rig.camera.position, this.lamps);
        this.setView(nearest);
        const other = otherMoment(this.page.views[nearest]!, moment, this.lamps);
        if (other) this.say(other);
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
    for (const [k, light] of [view.light, ...view.further].entries()) if (light) this.lamps[k]?.move(new Vector3(...light));
    for (const [k, mover] of (this.learned?.movers ?? []).entries()) {
      const [first, last] = mover.record.range;
      const slider = view.pose?.[k];
      if (slider !== undefined) mover.value = first + slider * (last - first);
    }
    this.view = index;
    this.presenter.references.comparison = null;
    this.exposed.reset();
    if (view.reference)
      void this.reference(index).then(
        (picture) => this.adapt(index, picture),
        () => {},
      );
    this.changed();
  }

  /** Camera and lights as they were baked, and what moves as the file shows it first. */
  goHome(): void {
    const { home, views } = this.page;
    const camera = home ?? views[0]?.camera ?? overview(this.learned?.core ?? new Box3());
    this.leaveView();
    this.place(() => this.rig.place(camera, 1));
    this.resetLight();
    for (const lamp of this.lamps) lamp.move(new Vector3(...lamp.variable.initial));
    for (const mover of this.learned?.movers ?? []) mover.value = mover.record.initial;
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

  /** Move the eye along its axes (right, up, ahead; shares of the diagonal of what is looked at), and turn it by radians. */
  fly(step: readonly [number, number, number], turn: number): void {
    this.userMoved = true;
    this.rig.fly(step, turn);
    this.invalidate();
  }

  /** Turn the eye by radians about what it looks at. */
  orbit(turn: number): void {
    this.userMoved = true;
    this.rig.orbit(turn);
    this.invalidate();
  }

  /** Evaluate the learned light at half resolution, or at full. */
  setHalf(on: boolean): void {
    if (this.half === on) return;
    this.half = on;
    this.presenter.references.comparison = null;
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

  /** Set a lamp of the scene by its name. */
  setLamp(name: string, setting: LampSetting): void {
    this.learned?.setLamp(name, setting);
    this.relit();
  }

  /** Move a node or clip of the file, in degrees, metres or shares; nothing changes where it has no such mover. */
  setMover(name: string, value: number): void {
    const mover = this.learned?.movers.find((other) => other.name === name);
    if (!mover || mover.value === value) return;
    mover.value = value;
    this.relit();
  }

  /** Turn the environment map, degrees; nothing changes where it is not turned so far. */
  setEnvironmentRotation(degrees: number): void {
    if (this.learned?.setEnvironmentRotation(degrees)) this.relit();
  }

  /** Set the time of day, hours; nothing changes where it is night then. */
  setDay(hour: number): void {
    if (this.learned?.setDay(hour)) this.relit();
    else this.say("It is night in this file at that time.");
  }

  setStillLight(on: boolean): void {
    // It brings the light back that a reference took the place of.
    this.leaveView();
    this.stillLight = on;
    this.changed();
  }

  setSplit(split: number): void {
    this.split = Math.min(1, Math.max(0, split));
    this.changed();
  }

  /** Choose what is to the left in split mode, if the file has it. */
  setAgainst(against: Against): void {
    if (!this.canHold(against)) return;
    if (needsReference(this) && against !== "reference") this.returnLight();
    this.against = against;
    if (this.mode === "split") this.setMode("split");
    else this.changed();
  }

  /** Go on to the next picture that the file has for the left in split mode. */
  nextAgainst(): void {
    const offered = AGAINST.filter((against) => this.canHold(against));
    this.setAgainst(offered[(offered.indexOf(this.against) + 1) % offered.length]!);
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
      if (!lost) {
        this.presenter.timer.restart();
        for (const lamp of this.lamps) lamp.move(lamp.value.clone());
      }
      this.emit("trouble", lost ? CONTEXT_LOST : "");
      this.invalidate();
    });
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

  private lightNow(): Parked {
    const { switches = [], movers = [] } = this.learned ?? {};
    return {
      lamps: this.lampController.states(),
      settings: switches.map(({ intensity, color: { r, g, b } }) => ({ intensity, color: [r, g, b] })),
      values: movers.map(({ value }) => value),
      stillLight: this.stillLight,
    };
  }

  /** Light and moving parts as the user left them before a reference was shown. */
  private returnLight(): void {
    const { parked } = this;
    if (parked === null) return;
    this.lampController.restore(parked.lamps);
    for (const [k, lamp] of (this.learned?.switches ?? []).entries()) lamp.set(parked.settings[k]!);
    for (const [k, mover] of (this.learned?.movers ?? []).entries()) mover.value = parked.values[k]!;
    this.stillLight = parked.stillLight;
    this.parked = null;
    this.view = null;
    this.presenter.references.comparison = null;
  }

  /** Camera or light no longer agree with a saved view: its reference no longer says anything. */
  private leaveView(relit = false): void {
    this.view = null;
    this.presenter.references.comparison = null;
    if (!needsReference(this)) return;
    this.mode = "learned";
    if (relit) this.parked = null;
    else this.returnLight();
    this.say("Path-traced pictures exist for the saved views alone. Back to learned light.");
  }

  /** The light of the bake. */
  private resetLight(): void {
    this.lampController.reset();
    this.stillLight = true;
  }

  /** There are other lamps than before, for which shaders must be compiled. */
  private relamped(): void {
    this.stage.embody();
    this.emit("lamps", undefined);
    void this.compile();
    this.changed();
  }

  private relit(): void {
    this.leaveView(true);
    this.scale.touch();
    this.changed();
  }

  private unload(): void {
    this.presenter.references.clear();
    this.stage.clear();
    this.asset = null;
    this.view = null;
    this.parked = null;
    this.preparing = false;
    this.mode = "learned";
  }
}
