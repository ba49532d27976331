/** A page that draws one frame through the depth of field of others, and through ours; `tools/lens-peers.mjs` drives it. */

import { Lens, readLibrary } from "lightwell/lens";
import { BlendFunction, DepthOfFieldEffect, EffectComposer, EffectPass, Pass, RenderPass } from "postprocessing";
import {
  DataTexture,
  FloatType,
  HalfFloatType,
  LinearFilter,
  Mesh,
  NearestFilter,
  PerspectiveCamera,
  PlaneGeometry,
  RedFormat,
  Scene,
  ShaderMaterial,
  type Texture,
  UniformsUtils,
  WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import { BokehShader } from "three/addons/shaders/BokehShader.js";
import { BokehShader as BokehShader2 } from "three/addons/shaders/BokehShader2.js";
import { dof } from "three/addons/tsl/display/DepthOfFieldNode.js";
import { pass, positionGeometry, texture, uniform, uv, vec4 } from "three/tsl";
import { NodeMaterial, RenderPipeline, RenderTarget, WebGPURenderer } from "three/webgpu";

export interface PeerFrame {
  readonly width: number;
  readonly height: number;
  /** Base64 of float32: linear RGBA and depth-buffer values in [0, 1], first row at the top. */
  readonly color: string;
  readonly depth: string;
  readonly near: number;
  readonly far: number;
  /** Vertical field of view, degrees. */
  readonly fovY: number;
  readonly focus: number;
  /** The same lens for all: metres. */
  readonly camera: { readonly focus: number; readonly focal: number; readonly fstop: number; readonly sensor: number };
  readonly libraries: readonly string[];
}

export type PeerSetting = Readonly<Record<string, number>>;
export type PeerName = "bokeh" | "bokeh2" | "dof" | "pmndrs" | "ours" | "plain";

export interface PeerAnswer {
  /** Base64 of float32 RGBA, first row at the top. */
  readonly picture: string;
  /** Wall milliseconds of each round, drawn and waited for. */
  readonly milliseconds: number[];
}

/** Draws with a setting, `rounds` times; answers with the last picture. */
type Runner = (setting: PeerSetting, rounds: number) => Promise<{ data: Float32Array; milliseconds: number[]; topDown: boolean }>;

const floats = (text: string): Float32Array<ArrayBuffer> => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
const base64 = (data: Float32Array): string => {
  const bytes = new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
  let text = "";
  for (let i = 0; i < bytes.length; i += 32768) text += String.fromCharCode(...bytes.subarray(i, i + 32768));
  return btoa(text);
};

function flipped(data: Float32Array, height: number): Float32Array<ArrayBuffer> {
  const stride = data.length / height;
  const rows = new Float32Array(data.length);
  for (let y = 0; y < height; y++) rows.set(data.subarray(y * stride, (y + 1) * stride), (height - 1 - y) * stride);
  return rows;
}

const asHalfReadable = { minFilter: LinearFilter, magFilter: LinearFilter };

function dataTexture(data: Float32Array<ArrayBuffer>, { width, height }: PeerFrame, channels: 1 | 4): DataTexture {
  const made = channels === 4 ? new DataTexture(data, width, height, undefined, FloatType) : new DataTexture(data, width, height, RedFormat, FloatType);
  Object.assign(made, channels === 4 ? asHalfReadable : { minFilter: NearestFilter, magFilter: NearestFilter });
  made.needsUpdate = true;
  return made;
}

function cameraOf({ width, height, near, far, fovY }: PeerFrame): PerspectiveCamera {
  const camera = new PerspectiveCamera(fovY, width / height, near, far);
  camera.updateMatrixWorld();
  return camera;
}

const VERTEX = "varying vec2 vUv; void main() { vUv = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }";

async function timed(rounds: number, draw: () => Promise<void> | void): Promise<number[]> {
  const times: number[] = [];
  for (let i = 0; i < rounds; i++) {
    const start = performance.now();
    await draw();
    times.push(performance.now() - start);
  }
  return times;
}

/** WebGL 2: the scene is a screen that carries the frame's colour and depth. */
function webgl(frame: PeerFrame) {
  const { width, height } = frame;
  const renderer = new WebGLRenderer({ antialias: false });
  renderer.setSize(width, height, false);
  const color = dataTexture(flipped(floats(frame.color), height), frame, 4);
  const depth = dataTexture(flipped(floats(frame.depth), height), frame, 1);
  const camera = cameraOf(frame);
  const quad = (material: ShaderMaterial): Scene => {
    const mesh = new Mesh(new PlaneGeometry(2, 2), material);
    mesh.frustumCulled = false;
    return new Scene().add(mesh);
  };
  const target = new WebGLRenderTarget(width, height, { type: FloatType });
  const read = (from: WebGLRenderTarget): Float32Array => {
    if (from.texture.type === HalfFloatType) {
      copy.uniforms.map!.value = from.texture;
      renderer.setRenderTarget(target);
      renderer.render(copyScene, camera);
      return read(target);
    }
    const data = new Float32Array(4 * width * height);
    renderer.readRenderTargetPixels(from, 0, 0, width, height, data);
    return data;
  };
  const copy = new ShaderMaterial({
    uniforms: { map: { value: null as Texture | null } },
    vertexShader: VERTEX,
    fragmentShader: "uniform sampler2D map; varying vec2 vUv; void main() { gl_FragColor = texture2D(map, vUv); }",
    depthTest: false,
  });
  const copyScene = quad(copy);
  return { renderer, color, depth, camera, quad, target, read };
}

function bokeh(frame: PeerFrame, second: boolean): Runner {
  const { renderer, color, depth, camera, quad, target, read } = webgl(frame);
  const shader = second ? BokehShader2 : BokehShader;
  const material = new ShaderMaterial({
    defines: second ? { RINGS: 5, SAMPLES: 4 } : { DEPTH_PACKING: 0, PERSPECTIVE_CAMERA: 1 },
    uniforms: UniformsUtils.clone(shader.uniforms as any),
    vertexShader: VERTEX,
    fragmentShader: shader.fragmentShader,
    depthTest: false,
  });
  const fixed: Record<string, unknown> = second
    ? { tColor: color, tDepth: depth, textureWidth: frame.width, textureHeight: frame.height, znear: frame.near, zfar: frame.far, shaderFocus: 0, focalDepth: frame.focus, gain: 0, fringe: 0, bias: 0 }
    : { tColor: color, tDepth: depth, nearClip: frame.near, farClip: frame.far, focus: frame.focus, aspect: camera.aspect };
  const scene = quad(material);
  return async (setting, rounds) => {
    for (const [name, value] of Object.entries({ ...fixed, ...setting })) material.uniforms[name]!.value = value;
    let data = new Float32Array(0) as Float32Array;
    const milliseconds = await timed(rounds, () => {
      renderer.setRenderTarget(target);
      renderer.render(scene, camera);
      data = read(target);
    });
    return { data, milliseconds, topDown: false };
  };
}

/** Keeps what the passes before it made. */
class Capture extends Pass {
  buffer: WebGLRenderTarget | null = null;
  constructor() {
    super("Capture");
    this.needsSwap = false;
  }
  override render(_: WebGLRenderer, input: WebGLRenderTarget): void {
    this.buffer = input;
  }
}

function pmndrs(frame: PeerFrame): Runner {
  const { renderer, color, depth, camera, quad, read } = webgl(frame);
  const scene = quad(
    new ShaderMaterial({
      uniforms: { color: { value: color }, depth: { value: depth } },
      vertexShader: VERTEX,
      fragmentShader: "uniform sampler2D color, depth; varying vec2 vUv; void main() { gl_FragColor = vec4(texture2D(color, vUv).rgb, 1.0); gl_FragDepth = texture2D(depth, vUv).r; }",
    }),
  );
  return async ({ range = 1, scale = 1, resolution = 1 }, rounds) => {
    const composer = new EffectComposer(renderer, { frameBufferType: HalfFloatType, multisampling: 0 });
    composer.autoRenderToScreen = false;
    composer.setSize(frame.width, frame.height, false);
    const effect = new DepthOfFieldEffect(camera, {
      blendFunction: BlendFunction.NORMAL,
      focusDistance: frame.focus,
      focusRange: range,
      bokehScale: scale,
      resolutionScale: resolution,
    });
    const capture = new Capture();
    composer.addPass(new RenderPass(scene, camera));
    composer.addPass(new EffectPass(camera, effect));
    composer.addPass(capture);
    let data = new Float32Array(0) as Float32Array;
    const milliseconds = await timed(rounds, () => {
      composer.render(1 / 60);
      data = read(capture.buffer!);
    });
    composer.dispose();
    return { data, milliseconds, topDown: false };
  };
}

/** three.js' depth of field for WebGPU, behind a pass whose scene is the frame. `plain` is the pass alone. */
async function node(frame: PeerFrame, plain: boolean): Promise<Runner> {
  const { width, height } = frame;
  const renderer = new WebGPURenderer({ antialias: false });
  await renderer.init();
  renderer.setSize(width, height, false);
  const camera = cameraOf(frame);
  const material = new NodeMaterial();
  const at = uv();
  // A texture's first row is at v = 0, which is the lower edge of the screen.
  const color = texture(dataTexture(flipped(floats(frame.color), height), frame, 4), at) as any;
  material.vertexNode = vec4(positionGeometry.xy, 0, 1);
  material.colorNode = vec4(color.rgb, 1);
  material.depthNode = (texture(dataTexture(flipped(floats(frame.depth), height), frame, 1), at) as any).r;
  const mesh = new Mesh(new PlaneGeometry(2, 2), material);
  mesh.frustumCulled = false;
  const scene = new Scene().add(mesh);
  const scenePass = pass(scene, camera, { samples: 0 });
  const [range, scale] = [uniform(1), uniform(1)];
  const pipeline = new RenderPipeline(renderer);
  pipeline.outputColorTransform = false;
  pipeline.outputNode = plain ? scenePass : dof(scenePass.getTextureNode(), scenePass.getViewZNode(), uniform(frame.focus) as any, range as any, scale as any);
  const target = new RenderTarget(width, height, { type: FloatType });
  const device = (renderer.backend as any).device as GPUDevice;
  const next = () => new Promise<void>((resolve) => void renderer.setAnimationLoop(() => resolve()));
  return async (setting, rounds) => {
    [range.value, scale.value] = [setting.range ?? 1, setting.scale ?? 1];
    // What nodes know is brought up to date once a frame of the animation loop; the first frame sets sizes.
    for (let i = 0; i < 2; i++) {
      await next();
      renderer.setRenderTarget(target);
      pipeline.render();
    }
    const milliseconds = await timed(rounds, async () => {
      await next();
      renderer.setRenderTarget(target);
      pipeline.render();
      await device.queue.onSubmittedWorkDone();
    });
    renderer.setAnimationLoop(null);
    const data = (await renderer.readRenderTargetPixelsAsync(target, 0, 0, width, height)) as Float32Array;
    return { data, milliseconds, topDown: true };
  };
}

async function ours(frame: PeerFrame): Promise<Runner> {
  const { width, height, near, far, camera } = frame;
  const adapter = (await navigator.gpu.requestAdapter())!;
  const device = await adapter.requestDevice();
  const upload = (data: Float32Array<ArrayBuffer>, format: "rgba32float" | "r32float") => {
    const made = device.createTexture({ size: [width, height], format, usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST });
    device.queue.writeTexture({ texture: made }, data, { bytesPerRow: (data.length / height) * 4 }, [width, height]);
    return made;
  };
  const [color, depth] = [upload(floats(frame.color), "rgba32float"), upload(floats(frame.depth), "r32float")];
  const libraries = await Promise.all(frame.libraries.map((text) => readLibrary(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)))));
  const picture = device.createTexture({ size: [width, height], format: "rgba32float", usage: GPUTextureUsage.STORAGE_BINDING | GPUTextureUsage.COPY_SRC });
  return async ({ layers = 2 }, rounds) => {
    const lens = await Lens.create(device, { libraries, layers: layers === 1 ? 1 : 2, format: "rgba32float" }, width, height);
    const milliseconds = await timed(rounds, async () => {
      const encoder = device.createCommandEncoder();
      lens.encode(encoder, { color, depth, depthMeaning: { kind: "planes", near, far }, camera, picture });
      device.queue.submit([encoder.finish()]);
      await device.queue.onSubmittedWorkDone();
    });
    const pitch = Math.ceil((16 * width) / 256) * 256;
    const copy = device.createBuffer({ size: pitch * height, usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ });
    const encoder = device.createCommandEncoder();
    encoder.copyTextureToBuffer({ texture: picture }, { buffer: copy, bytesPerRow: pitch }, [width, height]);
    device.queue.submit([encoder.finish()]);
    await copy.mapAsync(GPUMapMode.READ);
    const rows = new Float32Array(copy.getMappedRange());
    const data = new Float32Array(4 * width * height);
    for (let y = 0; y < height; y++) data.set(rows.subarray((y * pitch) / 4, (y * pitch) / 4 + 4 * width), 4 * width * y);
    copy.destroy();
    lens.dispose();
    return { data, milliseconds, topDown: true };
  };
}

const MAKERS: Record<PeerName, (frame: PeerFrame) => Runner | Promise<Runner>> = {
  bokeh: (frame) => bokeh(frame, false),
  bokeh2: (frame) => bokeh(frame, true),
  pmndrs,
  dof: (frame) => node(frame, false),
  plain: (frame) => node(frame, true),
  ours,
};

let frame: PeerFrame | null = null;
const runners = new Map<PeerName, Runner>();

declare global {
  interface Window {
    peersFrame(frame: PeerFrame): void;
    peersDraw(name: PeerName, setting: PeerSetting, rounds: number): Promise<PeerAnswer>;
    peersAdapter(): Promise<string>;
    peersReady: boolean;
  }
}

window.peersFrame = (given) => {
  frame = given;
  runners.clear();
};
window.peersDraw = async (name, setting, rounds) => {
  if (!runners.has(name)) runners.set(name, await MAKERS[name](frame!));
  const { data, milliseconds, topDown } = await runners.get(name)!(setting, rounds);
  return { picture: base64(topDown ? data : flipped(data, frame!.height)), milliseconds };
};
window.peersAdapter = async () => {
  const info = (await navigator.gpu?.requestAdapter())?.info;
  return info ? [info.vendor, info.architecture, info.description].filter(Boolean).join(" ") : "";
};
window.peersReady = true;
