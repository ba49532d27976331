/** A page that draws one file with either renderer of three.js, and says what is left when it is disposed of. */

import { type LampSetting, LearnedScene, LightwellLoaderPlugin, type Look, type Parts } from "lightwell";
import { FieldNodes, LearnedNodeScene, learnedLight, learnedRadiance } from "lightwell/webgpu";
import {
  type Camera,
  Color,
  DataTexture,
  EquirectangularReflectionMapping,
  FloatType,
  Matrix4,
  Mesh,
  MeshStandardMaterial,
  type Object3D,
  PerspectiveCamera,
  Quaternion,
  RGBAFormat,
  Scene,
  SphereGeometry,
  Vector3,
  WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { MeshBasicNodeMaterial, RenderTarget, WebGPURenderer } from "three/webgpu";

export interface Request {
  readonly glb: string;
  /** `webgl`: WebGLRenderer; `webgpu`: WebGPURenderer; `fallback`: the same on its WebGL 2 backend. */
  readonly kind: "webgl" | "webgpu" | "fallback";
  readonly width: number;
  readonly height: number;
  /** Samples of a pixel; WebGLRenderer alone. */
  readonly samples?: number;
  readonly camera: { position: [number, number, number]; target: [number, number, number]; fovY: number };
  readonly weights?: "inline" | "texture";
  /** Do it twice, and say what is left of the second time. */
  readonly twice?: boolean;
  /** Direct light too. */
  readonly direct?: boolean;
  /** Draw ordinary light maps in place of the learned light. */
  readonly lightmap?: boolean;
  readonly parts?: Parts;
  /** Lamps to add, after a first frame without them. */
  readonly added?: number;
  /** What to do to the file's materials after a first frame. */
  readonly edit?: "emissive" | "hidden" | "detached" | "attached";
  /** White light from everywhere, and what the scene makes of it. */
  readonly environment?: "keep" | "remove";
  /** Materials of the page's own that show the field of this number; WebGPURenderer alone. */
  readonly node?: number;
  readonly background?: number;
  /** Lamps of the scene itself. */
  readonly lamps?: Readonly<Record<string, LampSetting>>;
  /** An animation of lamps, at a time in seconds. */
  readonly playing?: { readonly name: string; readonly time: number };
  /** Values of nodes that move. */
  readonly movers?: Readonly<Record<string, number>>;
  /** Move root and camera together: the picture stays. */
  readonly moved?: boolean;
  /** Centre of a white ball of radius 0.25, which is added and lit by the probes of the file; under the root where `litUnder`. */
  readonly lit?: readonly [number, number, number];
  readonly litUnder?: boolean;
  /** What to compile after a first frame at full resolution. */
  readonly look?: Look;
}

export interface Answer {
  /** Linear RGBA radiance, first row at the top. */
  readonly data: number[];
  readonly backend: string;
  /** Geometries and textures after the scene was there once, while it is there again, and after that. */
  readonly memory: { geometries: number; textures: number }[];
  readonly lamps: { value: number[]; color: number[]; intensity: number }[];
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

/** White light from everywhere. */
function whiteSky(): DataTexture {
  const texture = new DataTexture(new Float32Array(4 * 64 * 32).fill(1), 64, 32, RGBAFormat, FloatType);
  texture.mapping = EquirectangularReflectionMapping;
  texture.needsUpdate = true;
  return texture;
}

type Learned = LearnedScene | LearnedNodeScene;
type Gltf = Awaited<ReturnType<typeof load>>;

/** One renderer and its adapter, as the rest of this page sees them. */
interface Stand {
  readonly renderer: { info: { memory: { geometries: number; textures: number } }; render(scene: Scene, camera: Camera): void };
  readonly backend: "webgl" | "webgpu";
  make(gltf: Gltf): Learned;
  compile(learned: Learned, scene: Scene, camera: Camera, look?: Look): Promise<void>;
  draw(learned: Learned, scene: Scene, camera: PerspectiveCamera): void;
  read(): Promise<number[]>;
  dispose(): void;
}

function webglStand({ width, height, samples = 0, weights, environment }: Request): Stand {
  const renderer = new WebGLRenderer({ canvas: document.createElement("canvas") });
  renderer.setSize(width, height, false);
  renderer.shadowMap.enabled = true;
  const target = new WebGLRenderTarget(width, height, { type: FloatType, samples });
  renderer.setRenderTarget(target);
  return {
    renderer,
    backend: "webgl",
    make: (gltf) => new LearnedScene(gltf, { renderer, ...(weights ? { weights } : {}), ...(environment ? { environment } : {}) }),
    compile: (learned, scene, camera, look) => (learned as LearnedScene).compile(renderer, scene, camera, look),
    draw: (learned, scene, camera) => (learned as LearnedScene).render(renderer, scene, camera, width, height),
    async read() {
      const rows = new Float32Array(4 * width * height);
      renderer.readRenderTargetPixels(target, 0, 0, width, height, rows);
      return upright(rows, width, height);
    },
    dispose() {
      renderer.dispose();
      renderer.forceContextLoss();
    },
  };
}

async function webgpuStand({ width, height, weights, environment, kind }: Request): Promise<Stand> {
  const renderer = new WebGPURenderer({ forceWebGL: kind === "fallback", antialias: false });
  await renderer.init();
  renderer.setSize(width, height, false);
  renderer.shadowMap.enabled = true;
  const target = new RenderTarget(width, height, { type: FloatType });
  renderer.setRenderTarget(target);
  const isWebgpu = (renderer.backend as unknown as { isWebGPUBackend?: boolean }).isWebGPUBackend === true;
  return {
    renderer: renderer as unknown as Stand["renderer"],
    backend: isWebgpu ? "webgpu" : "webgl",
    make: (gltf) => new LearnedNodeScene(gltf, { renderer, ...(weights ? { weights } : {}), ...(environment ? { environment } : {}) }),
    compile: (learned, scene, camera, look) => (learned as LearnedNodeScene).compile(renderer, scene, camera, look),
    draw: (learned, scene, camera) => (learned as LearnedNodeScene).render(renderer, scene, camera, width, height),
    async read() {
      const rows = (await renderer.readRenderTargetPixelsAsync(target, 0, 0, width, height)) as Float32Array<ArrayBuffer>;
      // WebGPU reads back top-down, WebGL bottom-up.
      return isWebgpu ? Array.from(rows) : upright(rows, width, height);
    },
    dispose: () => renderer.dispose(),
  };
}

function edit(root: Object3D, what: Request["edit"]): void {
  root.traverse((object) => {
    if (!(object instanceof Mesh)) return;
    const material = object.material as MeshStandardMaterial;
    if (what === "emissive") material.emissive.setRGB(0.5, 0, 0);
    if (what === "hidden") material.visible = false;
  });
}

/** A white ball that is not of the file. */
function whiteBall(place: readonly [number, number, number]): Mesh {
  const ball = new Mesh(new SphereGeometry(0.25, 128, 64), new MeshStandardMaterial({ color: 0xffffff, roughness: 1, metalness: 0 }));
  ball.position.set(...place);
  return ball;
}

/** Materials that show a field without a `LearnedNodeScene`. */
function showNode(gltf: Gltf, number: number): void {
  const record = learnedLight(gltf).fields[number]!;
  const field = new FieldNodes(record, "own", "inline");
  field.follow([new Vector3(...(learnedLight(gltf).variables[record.variable]?.initial ?? [0, 0, 0]))]);
  field.setGain(0, new Vector3(1, 1, 1));
  field.update();
  const material = new MeshBasicNodeMaterial();
  material.colorNode = learnedRadiance(field);
  gltf.scene.traverse((object) => {
    if (object instanceof Mesh) object.material = material;
  });
}

async function run(request: Request): Promise<Answer> {
  const stand = await (request.kind === "webgl" ? webglStand(request) : webgpuStand(request));
  const { renderer } = stand;
  const { camera, scene } = setUp(request, request.background);
  if (request.environment) scene.environment = whiteSky();
  const memory: Answer["memory"] = [];
  const home = camera.clone();
  let data: number[] = [];
  let lamps: Answer["lamps"] = [];
  for (const round of request.twice ? [0, 1] : [0]) {
    camera.copy(home);
    const gltf = await load(request.glb);
    if (request.node !== undefined) showNode(gltf, request.node);
    const learned = stand.make(gltf);
    scene.add(learned.root);
    if (request.moved) move(learned.root, camera);
    for (const [name, setting] of Object.entries(request.lamps ?? {})) learned.setLamp(name, setting);
    if (request.playing) learned.playAnimation(request.playing.name);
    for (const [name, value] of Object.entries(request.movers ?? {})) learned.setMover(name, value);
    const ball = request.lit ? whiteBall(request.lit) : null;
    if (ball) {
      (request.litUnder ? learned.root : scene).add(ball);
      await learned.addLit(ball);
    }
    const frame = () => {
      if (request.parts) learned.show(request.parts);
      learned.update();
      if (!request.direct && !request.parts) darken(learned.lamps);
      if (request.lightmap) learned.renderLightmap(renderer, scene, camera);
      else stand.draw(learned, scene, camera);
    };
    frame();
    if (request.playing) {
      learned.update(undefined, request.playing.time);
      stand.draw(learned, scene, camera);
    }
    for (let i = 0; i < (request.added ?? 0); i++) learned.addLamp();
    if (request.added || request.look) await stand.compile(learned, scene, camera, request.look);
    if (request.edit === "detached") learned.detach();
    else if (request.edit === "attached") {
      learned.detach();
      renderer.render(scene, camera);
      learned.attach();
      for (const lamp of learned.lamps) lamp.intensity *= 2;
      // Nodes of lights are brought up to date once a frame of the page.
      await new Promise(requestAnimationFrame);
    } else if (request.edit) edit(learned.root, request.edit);
    if (request.added || request.edit || request.look) frame();
    data = await stand.read();
    if (round > 0) memory.push(memoryOf(renderer));
    lamps = learned.lamps.map(({ value, color, intensity }) => ({ value: value.toArray(), color: color.toArray(), intensity }));
    learned.dispose();
    learned.root.removeFromParent();
    ball?.removeFromParent();
    ball?.geometry.dispose();
    renderer.render(scene, camera);
    memory.push(memoryOf(renderer));
  }
  stand.dispose();
  return { data, backend: stand.backend, memory, lamps };
}

declare global {
  interface Window {
    draw(request: Request): Promise<Answer>;
    ready: boolean;
  }
}

window.draw = run;
window.ready = true;
