/** What the user does with the lens, and when frames go through it. */

import { type PerspectiveCamera, Raycaster, Vector2 } from "three";
import type { LoadedAsset } from "./asset.ts";
import { loadLens } from "./lens-part.ts";
import type { LensFrame, LensPicture, PictureOptions } from "./lens-picture.ts";
import type { LensView } from "./lens-stage.ts";
import type { Mode } from "./modes.ts";
import type { Shown } from "./presenter.ts";
import type { Stage } from "./stage.ts";
import type { ToneMappingName } from "./tone-mapping.ts";

/** Distances in focus and f-numbers that may be set. */
export const FOCUS_RANGE = [0.15, 100] as const;
export const FSTOP_RANGE = [0.25, 22] as const;
/** Modes that show light alone; split does, unless it is held against a path-traced picture. */
const MODES: readonly Mode[] = ["learned", "direct", "indirect", "split", "lightmap"];

/** What the viewer lends to the lens. */
export interface LensHost {
  readonly canvas: HTMLCanvasElement;
  readonly options: PictureOptions;
  readonly stage: Stage;
  readonly camera: PerspectiveCamera;
  readonly toneMapping: ToneMappingName;
  /** The file that is shown. */
  readonly asset: LoadedAsset | null;
  changed(): void;
  say(message: string): void;
  /** A frame was drawn and waited for. */
  timed(milliseconds: number): void;
}

/** Whether the lens is on, where it is focused, and what is under way. */
export class LensController {
  on = false;
  readonly setting = { focus: 2, fstop: 1.4 };
  private readonly host: LensHost;
  private picture: LensPicture | null = null;
  private opening: Promise<LensPicture> | null = null;
  /** The file whose shaders are compiled. */
  private ready: LoadedAsset | null = null;
  /** What compiles shaders now. */
  private preparing: LensPicture | null = null;
  private busy = false;
  private again = false;
  /** Those who wait for a blurred frame. */
  private waiting: (() => void)[] = [];

  constructor(host: LensHost) {
    this.host = host;
  }

  /** The canvas that shows the picture through the lens; null while the page's own shows a sharp one. */
  get canvas(): HTMLCanvasElement | null {
    return this.picture && !this.picture.canvas.hidden ? this.picture.canvas : null;
  }

  /** Switch the lens; resolves when a blurred frame is shown, or the sharp one again. */
  async set(on: boolean, setting: { focus?: number; fstop?: number } = {}): Promise<void> {
    this.focusAt(setting.focus ?? this.setting.focus);
    this.setting.fstop = Math.min(FSTOP_RANGE[1], Math.max(FSTOP_RANGE[0], setting.fstop ?? this.setting.fstop));
    this.on = on;
    if (on && !this.picture && !(await this.open())) return;
    const shown = this.on ? new Promise<void>((resolve) => this.waiting.push(resolve)) : null;
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

  /**
   * Show a frame through the lens, if it is on and shaders are compiled. Returns whether the lens' canvas shows it, now or when the
   * frame before is done; where it does not, the page draws a sharp one. With `now` it is drawn at once.
   */
  draw(shown: Shown, now: boolean): boolean {
    const { picture, host } = this;
    const frame = this.on && picture ? this.frameOf(shown) : null;
    if (!frame || !picture || shown.preparing || this.isUnprepared(picture, frame)) {
      if (picture) picture.canvas.hidden = true;
      // Nobody waits for a frame that the mode does not have.
      if (!frame) this.answer();
      return false;
    }
    if (this.busy && !now) {
      this.again = true;
      return true;
    }
    const start = performance.now();
    this.busy = true;
    this.again = false;
    try {
      const { width, height } = host.canvas;
      picture.draw(frame, width, height).then(
        (again) => this.finish(picture, again, performance.now() - start),
        (error: unknown) => this.fail(picture, error),
      );
    } catch (error) {
      this.fail(picture, error);
      return false;
    }
    return true;
  }

  dispose(): void {
    this.on = false;
    this.picture?.dispose();
    this.picture = this.ready = this.preparing = null;
    this.busy = this.again = false;
  }

  /** Open a device; says whether there is one. */
  private async open(): Promise<boolean> {
    const { host } = this;
    try {
      this.opening ??= loadLens().then(({ LensPicture }) => LensPicture.open(host.canvas, host.options));
      const picture = await this.opening;
      if (this.picture !== picture) void picture.lost.then((message) => this.loseDevice(picture, message));
      this.picture = picture;
      return true;
    } catch (error) {
      this.on = false;
      host.say(textOf(error));
      host.changed();
      return false;
    } finally {
      this.opening = null;
    }
  }

  /** What a frame is drawn with; null in a mode that shows more than light. */
  private frameOf({ mode, against, split, exposure, glowing, stillLight }: Shown): LensFrame | null {
    const { stage, camera, toneMapping } = this.host;
    if (!stage.learned || !MODES.includes(mode) || (mode === "split" && against === "reference")) return null;
    const view = (name: Mode): LensView => ({
      parts: { raster: name !== "indirect", indirect: name !== "direct", still: stillLight && name !== "direct" },
      ...{ exposure, glowing, lightmap: name === "lightmap" },
    });
    const beside = mode === "split" && against !== "reference" ? view(against) : null;
    return { ...view(mode), beside, split, page: stage.learned, camera, toneMapping, setting: this.setting };
  }

  /** Whether shaders must be compiled first; that is begun. */
  private isUnprepared(picture: LensPicture, frame: LensFrame): boolean {
    const { asset } = this.host;
    if (this.preparing === picture) return true;
    if (this.ready === asset && !picture.follow(frame.page)) return false;
    void this.prepare(picture, frame, asset!);
    return true;
  }

  /** Load the file once more if it is another one, and compile its shaders. */
  private async prepare(picture: LensPicture, frame: LensFrame, asset: LoadedAsset): Promise<void> {
    this.preparing = picture;
    try {
      if (this.ready !== asset) {
        this.ready = null;
        picture.clear();
        const gltf = await asset.again();
        if (picture !== this.picture) return;
        picture.put(gltf);
      }
      await picture.compile(frame);
      if (picture === this.picture) this.ready = asset;
    } catch (error) {
      this.fail(picture, error);
    }
    if (this.preparing !== picture) return;
    this.preparing = null;
    this.host.changed();
  }

  private finish(picture: LensPicture, again: boolean, milliseconds: number): void {
    if (picture !== this.picture) return;
    this.busy = false;
    this.host.timed(milliseconds);
    if (this.on) picture.canvas.hidden = false;
    if (this.again || again || !this.on) this.host.changed();
    else this.answer();
  }

  /** Something does not work: sharp pictures do. */
  private fail(picture: LensPicture, error: unknown): void {
    if (picture !== this.picture) return;
    this.on = this.busy = false;
    this.host.say(textOf(error));
    this.answer();
    this.host.changed();
  }

  /** The device is gone: sharp pictures need none. */
  private loseDevice(picture: LensPicture, message: string): void {
    if (picture !== this.picture) return;
    this.dispose();
    this.host.say(`The lens lost its graphics device and is off${message ? `: ${message}` : ""}. Switch it on again to try once more.`);
    this.answer();
    this.host.changed();
  }

  private answer(): void {
    for (const resolve of this.waiting.splice(0)) resolve();
  }

  private focusAt(distance: number): void {
    this.setting.focus = Math.min(FOCUS_RANGE[1], Math.max(FOCUS_RANGE[0], distance));
  }
}

function textOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
