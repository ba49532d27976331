/** A custom element that shows a baked file: orbit, pinch, and nothing else to set up. */

import {
  ACESFilmicToneMapping,
  AgXToneMapping,
  type Box3,
  NeutralToneMapping,
  NoToneMapping,
  PCFShadowMap,
  PerspectiveCamera,
  Scene,
  type ToneMapping,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { LearnedScene } from "../learned-scene.ts";
import { LightwellLoaderPlugin } from "../loader.ts";

const TONE_MAPPINGS: Readonly<Record<string, ToneMapping>> = {
  agx: AgXToneMapping,
  aces: ACESFilmicToneMapping,
  neutral: NeutralToneMapping,
  none: NoToneMapping,
};
const MAX_PIXEL_RATIO = 2;
const FIELD_OF_VIEW = 40;
const STYLE = `:host { display: block; position: relative; aspect-ratio: 16 / 9; background: #16171a; }
canvas { display: block; position: absolute; inset: 0; width: 100%; height: 100%; touch-action: none; }
p { position: absolute; inset: auto 0 50%; margin: 0; text-align: center; font: 14px system-ui, sans-serif; color: #fff9; }`;

/** Servers that import this module have no elements. */
const ElementBase = (globalThis.HTMLElement ?? class {}) as typeof HTMLElement;

/** What belongs to one file. */
interface Shown {
  readonly learned: LearnedScene;
  readonly scene: Scene;
}

/**
 * `<lightwell-viewer src="scene.glb" exposure="1" tone-mapping="agx" camera="0 1 4 / 0 1 0"></lightwell-viewer>`
 *
 * Attributes: `src`; `exposure` (linear factor); `tone-mapping` (`agx`, `aces`, `neutral`, `none`); `camera` (eye / target, metres);
 * `light` (place of the first lamp). Events: `load`, and `error` whose `message` says why. `scene` is the `LearnedScene`.
 * It draws when something changes, not all the time, and frees everything when it leaves the document.
 */
export class LightwellViewer extends ElementBase {
  static readonly observedAttributes = ["src", "exposure", "tone-mapping", "camera", "light"];
  private readonly canvas = document.createElement("canvas");
  private readonly message = document.createElement("p");
  private renderer: WebGLRenderer | null = null;
  private controls: OrbitControls | null = null;
  private readonly camera = new PerspectiveCamera(FIELD_OF_VIEW);
  private shown: Shown | null = null;
  private requested = 0;
  /** Counts loads: one that was overtaken shows nothing. */
  private loads = 0;
  private readonly resized = new ResizeObserver(() => this.resize());

  constructor() {
    super();
    const style = document.createElement("style");
    style.textContent = STYLE;
    this.message.setAttribute("role", "status");
    this.attachShadow({ mode: "open" }).append(style, this.canvas, this.message);
  }

  /** What is shown; null until it is loaded. */
  get scene(): LearnedScene | null {
    return this.shown?.learned ?? null;
  }

  connectedCallback(): void {
    try {
      this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias: true, alpha: true });
    } catch {
      this.fail(new Error("This browser offers no WebGL 2."));
      return;
    }
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.enableDamping = true;
    this.controls.addEventListener("change", () => this.invalidate());
    this.resized.observe(this);
    this.resize();
    void this.load();
  }

  disconnectedCallback(): void {
    this.loads++;
    cancelAnimationFrame(this.requested);
    this.requested = 0;
    this.resized.disconnect();
    this.clear();
    this.controls?.dispose();
    this.controls = null;
    this.renderer?.dispose();
    this.renderer = null;
  }

  attributeChangedCallback(name: string, before: string | null, after: string | null): void {
    if (!this.renderer || before === after) return;
    if (name === "src") void this.load();
    else this.apply(name);
  }

  /** Draw a frame soon: call it after a change of `scene`. */
  invalidate(): void {
    if (this.requested === 0 && this.renderer) this.requested = requestAnimationFrame(() => this.draw());
  }

  private async load(): Promise<void> {
    const load = ++this.loads;
    const src = this.getAttribute("src");
    this.clear();
    if (!src) return;
    this.message.textContent = "Loading…";
    try {
      const loader = new GLTFLoader();
      const gltf = await loader.register((parser) => new LightwellLoaderPlugin(parser)).loadAsync(src);
      if (load !== this.loads || !this.renderer) return;
      const learned = new LearnedScene(gltf, { renderer: this.renderer });
      const scene = new Scene();
      scene.add(learned.root);
      this.shown = { learned, scene };
      for (const name of LightwellViewer.observedAttributes) this.apply(name);
      learned.update();
      await learned.compile(this.renderer, scene, this.camera);
      if (load !== this.loads) return;
      this.message.textContent = "";
      this.draw();
      this.dispatchEvent(new Event("load"));
    } catch (error) {
      if (load === this.loads) this.fail(error instanceof Error ? error : new Error(String(error)));
    }
  }

  private fail(error: Error): void {
    this.message.textContent = error.message;
    this.dispatchEvent(new ErrorEvent("error", { error, message: error.message }));
  }

  private apply(name: string): void {
    const { renderer, shown } = this;
    if (!renderer || !shown) return;
    const value = this.getAttribute(name);
    if (name === "exposure") renderer.toneMappingExposure = positive(value) ?? 1;
    if (name === "tone-mapping") renderer.toneMapping = TONE_MAPPINGS[value ?? "agx"] ?? AgXToneMapping;
    if (name === "light") {
      const place = vectors(value)?.[0];
      if (place) shown.learned.lamps[0]?.move(place);
    }
    if (name === "camera") this.place(vectors(value), shown.learned.bounds);
    this.invalidate();
  }

  /** Look as asked, or at the whole scene. */
  private place(asked: Vector3[] | null, bounds: Box3): void {
    const size = Math.max(bounds.getSize(new Vector3()).length(), 1e-6);
    const center = bounds.getCenter(new Vector3());
    const away = new Vector3(0.35, 0.25, 1).normalize().multiplyScalar((0.95 * size) / (2 * Math.sin((FIELD_OF_VIEW * Math.PI) / 360)));
    const [eye = center.clone().add(away), target = center] = asked ?? [];
    this.camera.near = size * 2e-3;
    this.camera.far = size * 40;
    this.camera.position.copy(eye);
    this.controls!.target.copy(target);
    this.camera.updateProjectionMatrix();
    this.controls!.update();
  }

  private resize(): void {
    if (!this.renderer) return;
    const [width, height] = [this.clientWidth || 1, this.clientHeight || 1];
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, MAX_PIXEL_RATIO));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  private draw(): void {
    this.requested = 0;
    const { renderer, shown, controls } = this;
    if (!renderer || !shown) return;
    const gliding = controls?.update() ?? false;
    const { width, height } = renderer.domElement;
    shown.learned.tint();
    shown.learned.update();
    shown.learned.render(renderer, shown.scene, this.camera, width, height);
    if (gliding) this.invalidate();
  }

  private clear(): void {
    this.shown?.learned.dispose();
    this.shown?.learned.root.removeFromParent();
    this.shown = null;
    this.message.textContent = "";
    this.renderer?.clear();
  }
}

function positive(text: string | null): number | null {
  const value = Number(text ?? Number.NaN);
  return value > 0 && Number.isFinite(value) ? value : null;
}

/** `x y z / x y z` as vectors; null when it is anything else. */
function vectors(text: string | null): Vector3[] | null {
  const found = (text ?? "").split("/").map((part) => part.trim().split(/[\s,]+/).map(Number));
  const fine = found.every((numbers) => numbers.length === 3 && numbers.every(Number.isFinite));
  return fine ? found.map((numbers) => new Vector3().fromArray(numbers)) : null;
}
