/** One renderer of three.js with its adapter, as the pages see them that run the same scenarios with every renderer. */

import { LearnedScene, LightwellLoaderPlugin, loadLight, type Look, type SceneOptions } from "lightwell";
import { LearnedNodeScene, loadLight as loadNodeLight } from "lightwell/webgpu";
import { type Camera, FloatType, type Object3D, PerspectiveCamera, type Scene, WebGLRenderer, WebGLRenderTarget } from "three";
import { type GLTF, GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { RenderTarget, WebGPURenderer } from "three/webgpu";

/** `webgl`: WebGLRenderer; `webgpu`: WebGPURenderer; `fallback`: the same on its WebGL 2 backend. */
export type Kind = "webgl" | "webgpu" | "fallback";
/** Red, green and blue of every pixel, linear; the first row is the lowest one. */
export type Picture = number[];
export type Learned = LearnedScene | LearnedNodeScene;
type Options = Omit<SceneOptions<never>, "renderer">;

/** What the constructors of both renderers take. */
export interface Parameters {
  readonly logarithmicDepthBuffer?: boolean;
}

export const [WIDTH, HEIGHT] = [64, 48];

export function makeCamera(x = 0): PerspectiveCamera {
  const camera = new PerspectiveCamera(36, WIDTH / HEIGHT, 0.01, 100);
  camera.position.set(x, 1, 4.2);
  camera.lookAt(0, 1, 0);
  camera.updateMatrixWorld();
  return camera;
}

/** Bytes of the page's file of this name. */
export const bytesOf = (name = "glb") => Uint8Array.from(atob(document.body.dataset[name]!), (c) => c.charCodeAt(0)).buffer;
export const load = (name?: string): Promise<GLTF> =>
  new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser)).parseAsync(bytesOf(name), "");

/** A renderer of some kind; what is `null` on one of them is tested with the other. */
export interface Stand {
  readonly kind: Kind;
  readonly renderer: WebGLRenderer | WebGPURenderer;
  readonly webgl: WebGLRenderer | null;
  readonly webgpu: WebGPURenderer | null;
  /** Light a loaded file with the adapter of this renderer. */
  light(gltf: GLTF, options?: Options): Learned;
  /** `loadLight` for this renderer. */
  loadLight(file: ArrayBuffer, model: Object3D): Promise<Learned>;
  /** `learned.update` for this renderer, which is not the one of the options. */
  update(learned: Learned): void;
  draw(scene: Scene, camera?: Camera, width?: number): Promise<Picture>;
  /** Draw a look, once it is compiled. */
  drawLook(learned: Learned, scene: Scene, look: Look): Promise<Picture>;
  /** One more renderer of this kind. */
  another(parameters?: Parameters): Promise<Stand>;
  /** Lose the device, and come back: with the same renderer, or with a new one where three.js restores none. */
  loseDevice(): Promise<Stand>;
  dispose(): void;
}

export function makeStand(kind: Kind, parameters: Parameters = {}): Promise<Stand> {
  return kind === "webgl" ? Promise.resolve(webglStand(parameters)) : webgpuStand(kind, parameters);
}

/** What is the same for both. */
function setUp(renderer: WebGLRenderer | WebGPURenderer): void {
  renderer.setSize(WIDTH, HEIGHT, false);
  renderer.shadowMap.enabled = true;
}

/** One target for each width: WebGPURenderer updates everything when it draws into another one, which would hide what is not updated. */
function keptTargets<T>(make: (width: number) => T): (width: number) => T {
  const made = new Map<number, T>();
  return (width) => {
    if (!made.has(width)) made.set(width, make(width));
    return made.get(width)!;
  };
}

const withoutAlpha = (rows: Float32Array) => Array.from(rows).filter((_, i) => i % 4 < 3);

function webglStand(parameters: Parameters): Stand {
  const renderer = new WebGLRenderer({ canvas: document.createElement("canvas"), ...parameters });
  setUp(renderer);
  const targets = keptTargets((width) => new WebGLRenderTarget(width, HEIGHT, { type: FloatType }));
  const read = (target: WebGLRenderTarget, width: number) => {
    const rows = new Float32Array(4 * width * HEIGHT);
    renderer.readRenderTargetPixels(target, 0, 0, width, HEIGHT, rows);
    renderer.setRenderTarget(null);
    return withoutAlpha(rows);
  };
  const stand: Stand = {
    kind: "webgl",
    renderer,
    webgl: renderer,
    webgpu: null,
    light: (gltf, options) => new LearnedScene(gltf, { renderer, ...options }),
    loadLight: (file, model) => loadLight(file, model, { renderer }),
    update: (learned) => (learned as LearnedScene).update(renderer),
    async draw(scene, camera = makeCamera(), width = WIDTH) {
      const target = targets(width);
      renderer.setRenderTarget(target);
      renderer.render(scene, camera);
      return read(target, width);
    },
    async drawLook(learned, scene, look) {
      const target = targets(WIDTH);
      renderer.setRenderTarget(target);
      await (learned as LearnedScene).compile(renderer, scene, makeCamera(), look);
      (learned as LearnedScene).render(renderer, scene, makeCamera(), WIDTH, HEIGHT);
      return read(target, WIDTH);
    },
    another: async (others = {}) => webglStand(others),
    async loseDevice() {
      const restored = new Promise((resolve) => renderer.domElement.addEventListener("webglcontextrestored", resolve, { once: true }));
      renderer.forceContextLoss();
      await new Promise((resolve) => setTimeout(resolve, 50));
      renderer.forceContextRestore();
      await restored;
      return stand;
    },
    dispose() {
      renderer.dispose();
      renderer.forceContextLoss();
    },
  };
  return stand;
}

/** The parts of three.js' backends that have a device. */
interface Backend {
  readonly isWebGPUBackend?: boolean;
  readonly device?: GPUDevice;
  readonly gl?: WebGL2RenderingContext;
}

async function webgpuStand(kind: Kind, parameters: Parameters): Promise<Stand> {
  const renderer = new WebGPURenderer({ forceWebGL: kind === "fallback", antialias: false, ...parameters });
  await renderer.init();
  setUp(renderer);
  const backend = renderer.backend as unknown as Backend;
  if ((backend.isWebGPUBackend === true) !== (kind === "webgpu")) throw new Error(`expected the backend '${kind}', found another one`);
  const targets = keptTargets((width) => new RenderTarget(width, HEIGHT, { type: FloatType }));
  /** WebGPU reads back from the top to the bottom. */
  const upright = (rows: Float32Array, width: number) =>
    kind === "fallback" ? rows : Float32Array.from(rows, (_, i) => rows[4 * width * (HEIGHT - 1 - Math.floor(i / (4 * width))) + (i % (4 * width))]!);
  const read = async (target: RenderTarget, width: number) => {
    const rows = (await renderer.readRenderTargetPixelsAsync(target, 0, 0, width, HEIGHT)) as Float32Array;
    renderer.setRenderTarget(null);
    return withoutAlpha(upright(rows, width));
  };
  return {
    kind,
    renderer,
    webgl: null,
    webgpu: renderer,
    light: (gltf, options) => new LearnedNodeScene(gltf, { renderer, ...options }),
    loadLight: (file, model) => loadNodeLight(file, model, { renderer }),
    update: (learned) => (learned as LearnedNodeScene).update(renderer),
    async draw(scene, camera = makeCamera(), width = WIDTH) {
      const target = targets(width);
      renderer.setRenderTarget(target);
      renderer.render(scene, camera);
      return read(target, width);
    },
    async drawLook(learned, scene, look) {
      const target = targets(WIDTH);
      renderer.setRenderTarget(target);
      await (learned as LearnedNodeScene).compile(renderer, scene, makeCamera(), look);
      (learned as LearnedNodeScene).render(renderer, scene, makeCamera(), WIDTH, HEIGHT);
      return read(target, WIDTH);
    },
    another: (others = {}) => webgpuStand(kind, others),
    async loseDevice() {
      backend.device?.destroy();
      backend.gl?.getExtension("WEBGL_lose_context")!.loseContext();
      await new Promise((resolve) => setTimeout(resolve, 50));
      renderer.dispose();
      return webgpuStand(kind, parameters);
    },
    dispose() {
      renderer.dispose();
      backend.device?.destroy();
      backend.gl?.getExtension("WEBGL_lose_context")?.loseContext();
    },
  };
}

declare global {
  interface Window {
    /** Runs one of a page's scenarios with a renderer of its own. */
    scenario(name: string, kind: Kind): Promise<unknown>;
  }
}

/** Let the test call these functions by name, each with a renderer of its own. */
export function offer(scenarios: Readonly<Record<string, (stand: Stand) => Promise<unknown>>>): void {
  window.scenario = async (name, kind) => {
    const stand = await makeStand(kind);
    const result = await scenarios[name]!(stand);
    stand.dispose();
    return result;
  };
}

