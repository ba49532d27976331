/** A custom element that shows a baked file: nothing to set up, and as many on a page as there is room for. */

import { PerspectiveCamera, Scene } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { type GLTF, GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { filterAnisotropically } from "../anisotropy.ts";
import { LearnedScene } from "../learned-scene.ts";
import { LightwellLoaderPlugin } from "../loader.ts";
import { SkyBackground } from "../sky-background.ts";
import { moverProps, setMovers } from "../mover-props.ts";
import { onPixelRatio } from "../pixel-ratio.ts";
import { readMoverValues } from "../mover-values.ts";
import type { Mover } from "../movers.ts";
import { readLampSettings } from "../switches.ts";
import { isForeign, UnknownNames } from "../unknown-names.ts";
import { positive, share, toneMappingOf, vectors } from "./attributes.ts";
import { type Client, SharedRenderer } from "./shared-renderer.ts";
import { placeCamera } from "./view-camera.ts";

const MAX_PIXEL_RATIO = 2;
/** A lazy element loads when it is this near to what is seen. */
const NEAR = "200px";
const STYLE = `:host { display: block; position: relative; aspect-ratio: 16 / 9; background: #16171a; overflow: hidden; }
canvas, img { display: block; position: absolute; inset: 0; width: 100%; height: 100%; }
img { object-fit: cover; }
:host([controls]) canvas { touch-action: none; cursor: grab; }
canvas:focus-visible { outline: 2px solid #ffb454; outline-offset: -2px; }
p { position: absolute; inset: auto 1em 1em; margin: 0; text-align: center; font: 14px system-ui, sans-serif; color: #fff; text-shadow: 0 0 4px #000; }
progress { position: absolute; inset: auto 0 0; width: 100%; height: 3px; appearance: none; border: 0; background: #fff2; }
progress::-webkit-progress-bar { background: #fff2; }
progress::-webkit-progress-value { background: #ffb454; }
progress::-moz-progress-bar { background: #ffb454; }
[hidden] { display: none; }`;

/** Attributes that are no properties of the element. */
const TAKEN = ["src", "poster", "alt", "controls", "exposure", "camera", "light", "loading", "day", "environment-rotation", "lamps", "movers", "tone-mapping", "class", "part", "exportparts", "style", "is"];

/** Servers that import this module have no elements. */
const ElementBase = (globalThis.HTMLElement ?? class {}) as typeof HTMLElement;

/** What belongs to one file. */
interface Shown {
  /** Whether its shaders are compiled: to draw before would hold up the page until they are. */
  ready: boolean;
  readonly gltf: GLTF;
  readonly learned: LearnedScene;
  readonly scene: Scene;
  /** The sky behind it; null where the file has none. */
  readonly sky: SkyBackground | null;
  /** What moves, by attributes. */
  readonly movers: ReadonlyMap<string, Mover>;
  /** Attributes, lamps and movers that were warned of. */
  readonly unknown: UnknownNames;
}

/**
 * `<lightwell-viewer src="scene.glb" alt="A room lit by one lamp" controls></lightwell-viewer>`
 *
 * Attributes: `src`; `poster` (a picture to show until the scene is there); `alt` (what is seen, in words); `controls` (the visitor may
 * orbit and zoom); `camera` (name of a camera of the file, or "eye / target" in metres; the file's first camera unless given); `loading`
 * (`lazy`: when it comes near); `exposure` (linear factor, the file's own unless given); `tone-mapping` (`agx`, `aces`, `neutral`, `none`);
 * `light` (place of the first lamp); `day` (time of day, `18:30`); `environment-rotation` (degrees); `lamps` (the scene's own: `desk:0.3;bed:0:ffcc88`, dimmer and colour by name); `movers` (what moves: `Door:45`, degrees, metres or a share of a clip);
 * `door` (the same by its name in lower case: 0 to 1 of its range; wins over `movers`). Events: `load`; `progress` with `loaded` and `total` bytes; `error` whose `message` says why.
 * `scene` is the `LearnedScene`: call `invalidate` after a change of it. All elements of a page share one renderer.
 */
export class LightwellViewer extends ElementBase implements Client {
  static readonly observedAttributes = ["src", "poster", "alt", "controls", "exposure", "tone-mapping", "camera", "light", "day", "environment-rotation", "lamps", "movers"];
  private readonly canvas = document.createElement("canvas");
  private readonly poster = document.createElement("img");
  private readonly message = document.createElement("p");
  private readonly bar = document.createElement("progress");
  private readonly camera = new PerspectiveCamera();
  private shared: SharedRenderer | null = null;
  private orbit: OrbitControls | null = null;
  private shown: Shown | null = null;
  private requested = 0;
  /** Counts loads: one that was overtaken shows nothing. */
  private loads = 0;
  private readonly resized = new ResizeObserver(() => this.resize());
  /** Ends what hears of another pixel ratio. */
  private unheard = () => {};
  private nearing: IntersectionObserver | null = null;
  /** Attributes with the names of what moves, which only the file knows. */
  private readonly short = new MutationObserver((changes) => {
    this.checkNames(changes.map(({ attributeName }) => attributeName ?? ""));
    if (changes.some(({ attributeName }) => this.shown?.movers.has(attributeName ?? ""))) this.apply("movers");
  });

  constructor() {
    super();
    const style = document.createElement("style");
    style.textContent = STYLE;
    this.bar.hidden = this.poster.hidden = true;
    this.poster.alt = "";
    this.attachShadow({ mode: "open" }).append(style, this.canvas, this.poster, this.bar, this.message);
  }

  /** What is shown; null until it is loaded. */
  get scene(): LearnedScene | null {
    return this.shown?.learned ?? null;
  }

  connectedCallback(): void {
    for (const name of ["poster", "alt", "controls"]) this.apply(name);
    this.resized.observe(this);
    this.unheard = onPixelRatio(() => this.resize());
    if (this.getAttribute("loading") !== "lazy") return this.start();
    this.nearing = new IntersectionObserver((entries) => entries.some(({ isIntersecting }) => isIntersecting) && this.start(), { rootMargin: NEAR });
    this.nearing.observe(this);
  }

  disconnectedCallback(): void {
    this.loads++;
    cancelAnimationFrame(this.requested);
    this.requested = 0;
    this.nearing?.disconnect();
    this.resized.disconnect();
    this.unheard();
    this.clear();
    this.orbit?.dispose();
    this.orbit = null;
    this.shared?.leave(this);
    this.shared = null;
  }

  attributeChangedCallback(name: string, before: string | null, after: string | null): void {
    if (before === after || !this.isConnected) return;
    if (name === "src" && this.shared) void this.load();
    else this.apply(name);
  }

  /** Draw a frame soon: call it after a change of `scene`. */
  invalidate(): void {
    if (this.requested === 0 && this.shown) this.requested = requestAnimationFrame(() => this.draw());
  }

  /** The graphics context was lost, or is back. */
  onContext(lost: boolean): void {
    this.say(lost ? "The graphics context was lost; it usually comes back by itself." : "");
    if (lost) return;
    for (const lamp of this.shown?.learned.lamps ?? []) lamp.renewShadow();
    this.invalidate();
  }

  private start(): void {
    this.nearing?.disconnect();
    if (this.shared) return;
    try {
      this.shared = SharedRenderer.join(this);
    } catch {
      return this.fail(new Error("This browser offers no WebGL 2."));
    }
    this.resize();
    void this.load();
  }

  private async load(): Promise<void> {
    const load = ++this.loads;
    const src = this.getAttribute("src");
    this.clear();
    if (!src || !this.shared) return;
    this.say(this.poster.hidden ? "Loading…" : "");
    try {
      const { renderer } = this.shared;
      const loader = new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser, { renderer }));
      const gltf = await loader.loadAsync(src, (event) => this.progress(event, load));
      if (load !== this.loads || !this.shared) return;
      filterAnisotropically(gltf.scene);
      const learned = new LearnedScene(gltf, { renderer });
      const scene = new Scene();
      scene.add(learned.root);
      const sky = learned.hasSky ? new SkyBackground(learned.environment) : null;
      scene.background = sky?.texture ?? null;
      const movers = moverProps(learned.movers, (name) => TAKEN.includes(name) || name in this, "lightwell-viewer");
      const unknown = new UnknownNames("lightwell-viewer", learned, movers.keys(), "environment-rotation");
      const shown: Shown = { ready: false, gltf, learned, scene, sky, movers, unknown };
      this.shown = shown;
      this.short.observe(this, { attributes: true });
      this.checkNames(this.getAttributeNames());
      for (const name of ["camera", "light", "day", "environment-rotation", "lamps", "movers"]) this.apply(name);
      learned.update(renderer);
      // It is a part of shaders, and the renderer has that of the element that drew last.
      renderer.toneMapping = toneMappingOf(this.getAttribute("tone-mapping"));
      await learned.compile(renderer, scene, this.camera);
      if (load !== this.loads) return;
      shown.ready = true;
      this.say("");
      this.bar.hidden = this.poster.hidden = true;
      this.draw();
      this.dispatchEvent(new Event("load"));
    } catch (error) {
      if (load === this.loads) this.fail(error instanceof Error ? error : new Error(String(error)));
    }
  }

  private progress({ loaded, total, lengthComputable }: ProgressEvent, load: number): void {
    if (load !== this.loads) return;
    this.bar.hidden = false;
    if (lengthComputable) [this.bar.value, this.bar.max] = [loaded, total];
    else this.bar.removeAttribute("value");
    this.dispatchEvent(new ProgressEvent("progress", { loaded, total, lengthComputable }));
  }

  private fail(error: Error): void {
    this.bar.hidden = true;
    this.say(error.message, "alert");
    this.dispatchEvent(new ErrorEvent("error", { error, message: error.message }));
  }

  private say(text: string, role = "status"): void {
    this.message.setAttribute("role", role);
    this.message.textContent = text;
  }

  private apply(name: string): void {
    const value = this.getAttribute(name);
    if (name === "poster") {
      this.poster.hidden = value === null || this.shown !== null;
      if (value !== null) this.poster.src = value;
    } else if (name === "alt") this.describe(value);
    else if (name === "controls") this.setControls(value !== null);
    else if (name === "light") {
      const place = vectors(value)?.[0];
      if (place) this.shown?.learned.lamps[0]?.move(place);
    } else if (name === "day") {
      if (value !== null) this.shown?.learned.setDay(value);
    } else if (name === "environment-rotation") {
      if (value !== null && value.trim() !== "") this.shown?.learned.setEnvironmentRotation(Number(value));
    } else if (name === "lamps") {
      const settings = readLampSettings(value);
      this.shown?.unknown.lamps(settings.keys());
      for (const lamp of this.shown?.learned.switches ?? []) {
        lamp.reset();
        if (settings.has(lamp.name)) lamp.set(settings.get(lamp.name)!);
      }
    } else if (name === "movers") {
      const values = readMoverValues(value);
      this.shown?.unknown.movers(values.keys());
      const given = [...(this.shown?.movers ?? [])].map(([prop, mover]) => [mover, share(this.getAttribute(prop))] as const);
      const shares = new Map(given.filter((pair): pair is [Mover, number] => pair[1] !== null));
      setMovers(this.shown?.learned.movers ?? [], (mover) => values.get(mover), shares);
    } else if (name === "camera" && this.shown) this.look(value, this.shown);
    this.invalidate();
  }

  /** Warn of attributes that say nothing: a misspelled name of what varies is one. */
  private checkNames(names: readonly string[]): void {
    // HTML's own attributes are properties too, some in other letters, such as `tabIndex`.
    const own = new Set(TAKEN);
    for (const name in this) own.add(name.toLowerCase());
    this.shown?.unknown.props(names, (name) => own.has(name) || isForeign(name));
  }

  private describe(alt: string | null): void {
    this.canvas.setAttribute("role", "img");
    if (alt === null) this.canvas.removeAttribute("aria-label");
    else this.canvas.setAttribute("aria-label", alt);
  }

  /** Let the visitor orbit, zoom and move by pointer and arrow keys, or not. */
  private setControls(on: boolean): void {
    if (on === (this.orbit !== null)) return;
    this.orbit?.dispose();
    this.orbit = null;
    this.canvas.removeAttribute("tabindex");
    if (!on) return;
    this.canvas.tabIndex = 0;
    this.orbit = new OrbitControls(this.camera, this.canvas);
    this.orbit.enableDamping = true;
    this.orbit.listenToKeyEvents(this.canvas);
    this.orbit.addEventListener("change", () => this.invalidate());
    if (this.shown) this.look(this.getAttribute("camera"), this.shown);
  }

  private look(asked: string | null, { gltf, learned }: Shown): void {
    const target = placeCamera(this.camera, asked, gltf, learned);
    this.camera.lookAt(target);
    this.orbit?.target.copy(target);
    this.orbit?.update();
  }

  private resize(): void {
    const [width, height] = [this.clientWidth || 1, this.clientHeight || 1];
    const ratio = Math.min(devicePixelRatio, MAX_PIXEL_RATIO);
    [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  private draw(): void {
    this.requested = 0;
    if (!this.shared || !this.shown?.ready) return;
    const gliding = this.orbit?.update() ?? false;
    const exposure = positive(this.getAttribute("exposure")) ?? this.shown.learned.exposure ?? 1;
    this.shown.sky?.update(this.shown.learned.lamps);
    const toneMapping = toneMappingOf(this.getAttribute("tone-mapping"));
    this.shared.draw({ ...this.shown, camera: this.camera, toneMapping, exposure }, this.canvas);
    if (gliding) this.invalidate();
  }

  private clear(): void {
    this.short.disconnect();
    this.shown?.learned.dispose();
    this.shown?.learned.root.removeFromParent();
    this.shown?.sky?.dispose();
    this.shown = null;
    this.say("");
    this.bar.hidden = true;
    this.canvas.getContext("2d")?.clearRect(0, 0, this.canvas.width, this.canvas.height);
  }
}
