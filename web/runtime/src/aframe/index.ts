/** `lightwell/aframe`: the component `lightwell` for A-Frame, whose own three.js it draws with. */

import { PCFShadowMap, Vector3, type WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { LearnedScene } from "../learned-scene.ts";
import { LightwellLoaderPlugin } from "../loader.ts";

/** What the component reads of A-Frame. */
interface Entity extends HTMLElement {
  readonly sceneEl: HTMLElement & { readonly renderer: WebGLRenderer };
  setObject3D(name: string, object: object): void;
  removeObject3D(name: string): void;
  emit(name: string, detail: object, bubbles?: boolean): void;
}

interface Component {
  readonly el: Entity;
  readonly data: { readonly src: string; readonly light: { x: number; y: number; z: number } | null; readonly environment: "keep" | "remove" };
  /** What is shown; null until it is loaded. */
  learned: LearnedScene | null;
  loads: number;
  load(): Promise<void>;
  move(): void;
  clear(): void;
}

/** A place, or nothing: A-Frame's own vectors have a default. */
const PLACE = {
  default: null,
  parse: (value: unknown) => {
    if (typeof value !== "string") return value;
    const [x, y, z] = value.trim().split(/[\s,]+/).map(Number);
    return [x, y, z].every(Number.isFinite) ? { x, y, z } : null;
  },
  stringify: (value: { x: number; y: number; z: number } | null) => (value ? `${value.x} ${value.y} ${value.z}` : ""),
};

const DEFINITION = {
  schema: { src: { type: "model" }, light: PLACE, environment: { default: "remove", oneOf: ["keep", "remove"] } },

  init(this: Component): void {
    this.learned = null;
    this.loads = 0;
    const { renderer } = this.el.sceneEl;
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = PCFShadowMap;
  },

  update(this: Component, before: { src?: string; environment?: string }): void {
    const { src, environment } = this.data;
    if (src === before.src && environment === before.environment) this.move();
    else void this.load();
  },

  tick(this: Component): void {
    this.learned?.update();
  },

  remove(this: Component): void {
    this.loads++;
    this.clear();
  },

  async load(this: Component): Promise<void> {
    const load = ++this.loads;
    this.clear();
    const { el, data } = this;
    if (!data.src) return;
    const { renderer } = el.sceneEl;
    try {
      const gltf = await new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser, { renderer })).loadAsync(data.src);
      if (load !== this.loads) return;
      this.learned = new LearnedScene(gltf, { renderer, environment: data.environment });
      this.move();
      this.learned.update();
      el.setObject3D("mesh", this.learned.root);
      el.emit("model-loaded", { format: "gltf", model: this.learned.root });
    } catch (error) {
      if (load !== this.loads) return;
      const message = error instanceof Error ? error.message : String(error);
      console.error(`lightwell: ${message}`);
      el.emit("model-error", { format: "gltf", src: data.src, message });
    }
  },

  move(this: Component): void {
    const { light } = this.data;
    if (light) this.learned?.lamps[0]?.move(new Vector3(light.x, light.y, light.z));
  },

  clear(this: Component): void {
    if (!this.learned) return;
    this.el.removeObject3D("mesh");
    this.learned.dispose();
    this.learned = null;
  },
};

/** The global A-Frame; none on servers, which may import this module. */
const { AFRAME } = globalThis as { AFRAME?: { registerComponent(name: string, definition: object): void; readonly components: Record<string, unknown> } };

if (AFRAME && !AFRAME.components.lightwell) AFRAME.registerComponent("lightwell", DEFINITION);
