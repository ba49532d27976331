/** `window.lightwell`: drives the page from tests, scripts and screenshots. */

import { Color, Vector3 } from "three";
import { loadUrl } from "./asset.ts";
import type { Against, Mode } from "./modes.ts";
import { readOptions } from "./options.ts";
import { applyState, linkTo } from "./page-state.ts";
import { recordTurn, takePicture } from "./turn.ts";
import type { Viewer } from "./viewer.ts";

/** What `stats()` returns. */
export interface Stats {
  readonly title: string;
  readonly mode: Mode;
  readonly view: number | null;
  readonly views: number;
  readonly lights: number[][];
  readonly half: boolean;
  readonly experts: boolean;
  /** Whether the file carries ordinary light maps. */
  readonly lightmaps: boolean;
  /** Size of the file. */
  readonly fileBytes: number;
  /** Name that the driver gives itself. */
  readonly renderer: string;
  /** Where the weights of the fields live. */
  readonly weights: "inline" | "texture" | "mixed" | "none";
  /** Multiply-adds of all fields, per pixel. */
  readonly macs: number;
  /** Whether the learned light is still being compiled. */
  readonly preparing: boolean;
  readonly fields: { name: string; role: string; placement: string; macs: number; bytes: number }[];
  readonly exposure: number;
  /** Median over the last frames; null before one was timed. */
  readonly frameMilliseconds: number | null;
  readonly comparison: { relativeError: number; psnr: number } | null;
  readonly contextLost: boolean;
  readonly trouble: string;
  readonly notice: string;
}

/** The automation interface; pixels come with the first row at the top. */
export interface Automation {
  /** Resolves when the first frame with learned light is drawn; rejects with the message that the page shows. */
  readonly ready: Promise<void>;
  renderOnce(): void;
  /** Resolves when the mode is drawn. */
  setMode(mode: Mode): Promise<void>;
  /** Go to a saved view and wait for its reference. */
  setView(index: number): Promise<void>;
  /** What is to the left in split mode, and where it ends. */
  setSplit(split: number, against?: Against): void;
  setCamera(position: number[], target: number[], fovY?: number): void;
  /** Move a lamp; returns whether the wish was clamped. */
  setLight(value: number[], index?: number): boolean;
  setIntensity(intensity: number, index?: number): void;
  setColor(linear: number[], index?: number): void;
  setStillLight(on: boolean): void;
  /** Add a lamp; resolves with its number, or -1, when it is drawn with learned light. */
  addLamp(variable?: number): Promise<number>;
  removeLamp(index: number): Promise<void>;
  /** Draw the picture with smooth edges, as it is shown once nothing has changed for a while. */
  renderSmooth(): void;
  /** Whether the picture that is shown has them, if it can. */
  rests(): boolean;
  /** Learned light at half resolution, or at full; resolves when it is drawn so. */
  setHalf(on: boolean): Promise<void>;
  /** The lens: on or off, distance in focus (metres) and f-number; resolves when the picture is shown. */
  setLens(on: boolean, setting?: { focus?: number; fstop?: number }): Promise<void>;
  /** Show another version of the scene, of an address; camera, lamps and mode stay. Resolves when it is drawn. */
  replace(url: string): Promise<void>;
  stats(): Stats;
  /** The address that shows the same. */
  link(): string;
  /** Show what the query of an address asks for, such as `movers=Door:45&day=18:30`; what it leaves out stays. Resolves when it is drawn. */
  apply(query: string): Promise<void>;
  /** The canvas as a PNG. */
  takePicture(): Promise<Blob>;
  /** A film (WebM) of a turn around what is looked at. */
  recordTurn(seconds?: number): Promise<Blob>;
  /** The canvas: 8-bit RGBA. */
  readPixels(): { width: number; height: number; data: Uint8Array };
  /** The learned picture before exposure and tone curve: linear RGBA radiance, alpha is coverage. */
  readRadiance(): { width: number; height: number; data: Float32Array };
  /** Median milliseconds of some frames that are drawn and waited for. */
  measure(frames?: number): number;
}

declare global {
  interface Window {
    lightwell: Automation;
  }
}

/** Publish the interface. */
export function automate(viewer: Viewer, ready: Promise<void>): void {
  let [notice, trouble] = ["", ""];
  viewer.on("notice", (text) => {
    notice = text;
  });
  viewer.on("trouble", (text) => {
    trouble = text;
  });
  window.lightwell = {
    ready,
    renderOnce: () => viewer.renderOnce(),
    renderSmooth: () => viewer.renderSmooth(),
    rests: () => viewer.rests,
    async setMode(mode) {
      viewer.setMode(mode);
      if (mode === "experts") await viewer.prepared();
    },
    async setView(index) {
      viewer.setView(index);
      if (viewer.page.views[index]?.reference) await viewer.reference(index);
    },
    setSplit(split, against) {
      if (against) viewer.setAgainst(against);
      viewer.setSplit(split);
    },
    setCamera: (position, target, fovY) => viewer.setCamera(position, target, fovY),
    setLight: (value, index = 0) => viewer.lampController.move(index, new Vector3().fromArray(value)),
    setIntensity: (intensity, index = 0) => viewer.lampController.setIntensity(index, intensity),
    setColor: (linear, index = 0) => viewer.lampController.setColor(index, new Color().fromArray(linear)),
    setStillLight: (on) => viewer.setStillLight(on),
    async addLamp(variable) {
      const index = viewer.lampController.add(variable);
      await viewer.prepared();
      return index;
    },
    async removeLamp(index) {
      viewer.lampController.remove(index);
      await viewer.prepared();
    },
    async setHalf(on) {
      viewer.setHalf(on);
      await viewer.prepared();
    },
    setLens: (on, setting) => viewer.lens.set(on, setting),
    async replace(url) {
      const shown = readOptions(new URL(linkTo(viewer, location.href)).search);
      const asset = await loadUrl(url, null, true);
      await viewer.load({ ...asset!, page: viewer.page });
      await applyState(viewer, shown);
    },
    stats: () => stats(viewer, notice, trouble),
    link: () => linkTo(viewer, location.href),
    apply: (query) => applyState(viewer, readOptions(query)),
    takePicture: () => takePicture(viewer),
    recordTurn: (seconds) => recordTurn(viewer, seconds),
    readPixels: () => viewer.readPixels(),
    readRadiance: () => viewer.readRadiance(),
    measure: (frames) => viewer.measure(frames),
  };
}

function stats(viewer: Viewer, notice: string, trouble: string): Stats {
  const placements = new Set(viewer.fields.map((field) => field.placement));
  return {
    title: viewer.title,
    mode: viewer.mode,
    view: viewer.view,
    views: viewer.page.views.length,
    lights: viewer.lamps.map((lamp) => lamp.value.toArray()),
    half: viewer.half,
    experts: viewer.hasExperts,
    lightmaps: viewer.hasLightmaps,
    fileBytes: viewer.fileBytes,
    renderer: viewer.rendererName,
    weights: placements.size > 1 ? "mixed" : ([...placements][0] ?? "none"),
    macs: viewer.learned?.macs ?? 0,
    preparing: viewer.preparing,
    fields: viewer.fields.map(({ record, placement, macs, bytes }) => ({
      name: record.name,
      role: record.role,
      placement,
      macs,
      bytes,
    })),
    exposure: viewer.exposure,
    frameMilliseconds: viewer.frameMilliseconds,
    comparison: viewer.comparison,
    contextLost: viewer.renderer.getContext().isContextLost(),
    trouble,
    notice,
  };
}
