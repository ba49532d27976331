/** What the user does with the lens, and when a frame is blurred. */

import { type PerspectiveCamera, Raycaster, Vector2, type WebGLRenderer } from "three";
import { LensPass, type LensSetting } from "./lens-pass.ts";
import type { Mode } from "./modes.ts";
import type { Presenter } from "./presenter.ts";
import type { Stage } from "./stage.ts";

/** Distances in focus and f-numbers that may be set. */
export const FOCUS_RANGE = [0.15, 100] as const;
export const FSTOP_RANGE = [0.25, 22] as const;
/** Modes that show light alone. */
const MODES: readonly Mode[] = ["learned", "direct", "indirect", "lightmap"];

/** What the viewer lends to the lens. */
export interface LensHost {
  readonly renderer: WebGLRenderer;
  readonly presenter: Presenter;
  readonly stage: Stage;
  readonly camera: PerspectiveCamera;
  readonly mode: Mode;
  changed(): void;
  say(message: string): void;
}

/** Whether the lens is on, where it is focused, and the frame that is being blurred. */
export class LensController {
  on = false;
  readonly setting: { -readonly [K in keyof LensSetting]: LensSetting[K] } = { focus: 2, fstop: 1.4 };
  private readonly host: LensHost;
  private pass: LensPass | null = null;
  private busy = false;
  private again = false;
  /** Those who wait for a blurred frame. */
  private waiting: (() => void)[] = [];

  constructor(host: LensHost) {
    this.host = host;
  }

  /** Whether the next frame is blurred before it is shown. */
  get active(): boolean {
    return this.on && this.pass !== null && MODES.includes(this.host.mode);
  }

  /** Switch the lens; resolves when a blurred frame is shown, or the sharp one again. */
  async set(on: boolean, setting: Partial<LensSetting> = {}): Promise<void> {
    this.focusAt(setting.focus ?? this.setting.focus);
    this.setting.fstop = Math.min(FSTOP_RANGE[1], Math.max(FSTOP_RANGE[0], setting.fstop ?? this.setting.fstop));
    if (on && !this.pass) {
      try {
        this.pass = await LensPass.open();
        void this.pass.lost.then((message) => this.loseDevice(message));
      } catch (error) {
        this.host.say(error instanceof Error ? error.message : String(error));
        this.host.changed();
        return;
      }
    }
    this.on = on;
    const shown = this.active ? new Promise<void>((resolve) => this.waiting.push(resolve)) : null;
    this.host.changed();
    await shown;
  }

  /** Focus on what lies under a point of the canvas, from −1 to 1; says whether there is anything. */
  focusUnder(x: number, y: number): boolean {
    const { camera, stage } = this.host;
    const ray = new Raycaster();
    ray.setFromCamera(new Vector2(x, y), camera);
    const [hit] = stage.learned ? ray.intersectObject(stage.learned.root, true) : [];
    if (!hit) return false;
    this.focusAt(-hit.point.applyMatrix4(camera.matrixWorldInverse).z);
    this.host.changed();
    return true;
  }

  /** A frame was drawn and not shown: blur it, then show it. */
  async blur(): Promise<void> {
    if (this.busy) {
      this.again = true;
      return;
    }
    this.busy = true;
    this.again = false;
    const { renderer, presenter, camera } = this.host;
    const { pipeline } = presenter;
    try {
      const picture = await this.pass!.blur(renderer, pipeline.total, camera, this.setting);
      if (this.active) pipeline.presentInstead(picture);
    } catch (error) {
      this.on = false;
      this.host.say(error instanceof Error ? error.message : String(error));
    }
    this.busy = false;
    if (this.again || !this.active) this.host.changed();
    if (!this.again) for (const resolve of this.waiting.splice(0)) resolve();
  }

  dispose(): void {
    this.on = false;
    this.pass?.dispose();
    this.pass = null;
  }

  /** The device is gone: sharp pictures need none. */
  private loseDevice(message: string): void {
    this.dispose();
    this.host.say(`The lens lost its graphics device and is off${message ? `: ${message}` : ""}. Switch it on again to try once more.`);
    for (const resolve of this.waiting.splice(0)) resolve();
    this.host.changed();
  }

  private focusAt(distance: number): void {
    this.setting.focus = Math.min(FOCUS_RANGE[1], Math.max(FOCUS_RANGE[0], distance));
  }
}
