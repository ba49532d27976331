/** A page that draws one file with either renderer of three.js, and says what is left when it is disposed of. */

import { LearnedScene, LightwellLoaderPlugin } from "lightwell";
import { LearnedNodeScene } from "lightwell/webgpu";
import {
  Color,
  FloatType,
  Matrix4,
  type Object3D,
  PerspectiveCamera,
  Quaternion,
  Scene,
  Vector3,
  WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { RenderTarget, WebGPURenderer } from "three/webgpu";

export interface Request {
  readonly glb: string;
  /** `webgl`: WebGLRenderer; `webgpu`: WebGPURenderer; `fallback`: the same on its WebGL 2 backend. */
  readonly kind: "webgl" | "webgpu" | "fallback";
  readonly width: number;
  readonly height: number;
  readonly camera: { position: [number, number, number]; target: [number, number, number]; fovY: number };
  readonly weights?: "inline" | "texture";
  /** Direct light too. */
  readonly direct?: boolean;
  /** Draw ordinary light maps in place of the learned light; `webgl` alone. */
  readonly lightmap?: boolean;
  readonly background?: number;
  /** Move root and camera together: the picture stays. */
  readonly moved?: boolean;
}

export interface Answer {
  /** Linear RGBA radiance, first row at the top. */
  readonly data: number[];
  readonly backend: string;
  /** Geometries and textures after the scene was there once, while it is there again, and after that. */
  readonly memory: { geometries: number; textures: number }[];
}

async function load(base64: string) {
  const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0)).buffer;
  return new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser)).parseAsync(bytes, "");
}

const PLACE = new Matrix4().compose(new Vector3(5, -2, 3), new Quaternion(0.2, 0.5, -0.1, 0.8).normalize(), new Vector3(0.25, 0.25, 0.25));

/** Put a root and the camera that looks at it somewhere else. */
function move(root: Object3D, camera: Object3D): void {
  root.applyMatrix4(PLACE);
  camera.position.applyMatrix4(PLACE);
  camera.quaternion.premultiply(root.quaternion);
}

function setUp({ width, height, camera: { position, target, fovY } }: Request, background?: number) {
  const camera = new PerspectiveCamera(fovY, width / height, 0.01, 100);
  camera.position.set(...position);
  camera.lookAt(...target);
  camera.updateMatrixWorld();
  const scene = new Scene();
  if (background !== undefined) scene.background = new Color(background);
  return { camera, scene };
}

/** Turn the rasterised light of lamps off: what is left is learned. */
const darken = (objects: readonly { object: Object3D }[]) => {
  for (const { object } of objects) (object as unknown as { intensity: number }).intensity = 0;
};

const memoryOf = ({ info }: { info: { memory: { geometries: number; textures: number } } }) => ({
  geometries: info.memory.geometries,
  textures: info.memory.textures,
});

function upright(rows: ArrayLike<number>, width: number, height: number): number[] {
  const stride = 4 * width;
  return Array.from({ length: height }, (_, y) => Array.from(rows).slice((height - 1 - y) * stride, (height - y) * stride)).flat();
}

async function runWebgl(request: Request): Promise<Answer> {
  const { width, height } = request;
  const renderer = new WebGLRenderer({ canvas: document.createElement("canvas") });
  renderer.setSize(width, height, false);
  renderer.shadowMap.enabled = true;
  const { camera, scene } = setUp(request, request.background);
  const target = new WebGLRenderTarget(width, height, { type: FloatType });
  renderer.setRenderTarget(target);
  const memory: Answer["memory"] = [];
  const home = camera.clone();
  const rows = new Float32Array(4 * width * height);
  for (const round of [0, 1]) {
  camera.copy(home);
  const learned = new LearnedScene(await load(request.glb), { renderer, ...(request.weights ? { weights: request.weights } : {}) });
  scene.add(learned.root);
  if (request.moved) move(learned.root, camera);
  learned.update();
  if (!request.direct) darken(learned.lamps);
  if (request.lightmap) learned.renderLightmap(renderer, scene, camera);
  else learned.render(renderer, scene, camera, width, height);
  renderer.readRenderTargetPixels(target, 0, 0, width, height, rows);
  if (round === 1) memory.push(memoryOf(renderer));
  learned.dispose();
  learned.root.removeFromParent();
  renderer.render(scene, camera);
  memory.push(memoryOf(renderer));
  }
  renderer.dispose();
  renderer.forceContextLoss();
  return { data: upright(rows, width, height), backend: "webgl", memory };
}

async function runWebgpu(request: Request): Promise<Answer> {
  const { width, height } = request;
  const renderer = new WebGPURenderer({ forceWebGL: request.kind === "fallback", antialias: false });
  await renderer.init();
  renderer.setSize(width, height, false);
  renderer.shadowMap.enabled = true;
  const { camera, scene } = setUp(request, request.background);
  const target = new RenderTarget(width, height, { type: FloatType });
  renderer.setRenderTarget(target);
  const memory: Answer["memory"] = [];
  const home = camera.clone();
  let rows = new Float32Array(0);
  for (const round of [0, 1]) {
  camera.copy(home);
  const learned = new LearnedNodeScene(await load(request.glb), request.weights ? { weights: request.weights } : {});
  scene.add(learned.root);
  if (request.moved) move(learned.root, camera);
  learned.update();
  if (!request.direct) darken(learned.lamps);
  renderer.render(scene, camera);
  rows = (await renderer.readRenderTargetPixelsAsync(target, 0, 0, width, height)) as Float32Array<ArrayBuffer>;
  if (round === 1) memory.push(memoryOf(renderer));
  learned.dispose();
  learned.root.removeFromParent();
  renderer.render(scene, camera);
  memory.push(memoryOf(renderer));
  }
  const isWebgpu = (renderer.backend as unknown as { isWebGPUBackend?: boolean }).isWebGPUBackend === true;
  renderer.dispose();
  // WebGPU reads back top-down, WebGL bottom-up.
  const data = isWebgpu ? Array.from(rows) : upright(rows, width, height);
  return { data, backend: isWebgpu ? "webgpu" : "webgl", memory };
}

declare global {
  interface Window {
    draw(request: Request): Promise<Answer>;
    ready: boolean;
  }
}

window.draw = (request) => (request.kind === "webgl" ? runWebgl(request) : runWebgpu(request));
window.ready = true;
