/** A page with the lens behind a pass of three.js: a lit square before a wall, at rest or flying to the right. */

import { readLibrary } from "lightwell/lens";
import { LensNode } from "lightwell/lens/three";
import { Color, FloatType, Mesh, MeshBasicMaterial, PerspectiveCamera, PlaneGeometry, Scene } from "three";
import { mrt, output, pass, velocity } from "three/tsl";
import { RenderPipeline, RenderTarget, WebGPURenderer } from "three/webgpu";

export interface ThreeRequest {
  readonly libraries: readonly string[];
  readonly reversed: boolean;
  readonly enabled: boolean;
  /** Radius of the blur of the square, px: it lies in front of focus. */
  readonly blur: number;
  /** Pixels that the square moves to the right from frame to frame, with an open shutter. */
  readonly speed: number;
}

const SIZE = 64;
const bytes = (text: string) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

/** One unit is 32 px at distance 1: tan(fov/2) = 1. */
const PIXELS_PER_UNIT = SIZE / 2;
/** Distances of the square and of the wall, which is in focus. */
const [NEAR, FAR] = [1, 4];

/** A renderer with a scene behind the lens; compiling the lens takes longest. */
interface Stand {
  draw(request: ThreeRequest): Promise<number[]>;
  /** Free it; says how many buffers of the lens are left. */
  dispose(): number;
}

async function makeStand(libraries: readonly string[], reversed: boolean): Promise<Stand> {
  const renderer = new WebGPURenderer({ antialias: false, reversedDepthBuffer: reversed });
  await renderer.init();
  const device = (renderer.backend as unknown as { device: GPUDevice }).device;
  let alive = 0;
  const create = device.createBuffer.bind(device);
  device.createBuffer = (descriptor) => {
    const buffer = create(descriptor);
    if (descriptor.label?.startsWith("lens")) {
      alive++;
      const destroy = buffer.destroy.bind(buffer);
      buffer.destroy = () => {
        alive--;
        return destroy();
      };
    }
    return buffer;
  };
  renderer.setSize(SIZE, SIZE, false);
  const camera = new PerspectiveCamera(90, 1, 0.1, 100);
  const scene = new Scene();
  const wall = new Mesh(new PlaneGeometry(20, 20), new MeshBasicMaterial({ color: new Color(0, 0, 1) }));
  wall.position.z = -FAR;
  const square = new Mesh(new PlaneGeometry(0.5, 0.5), new MeshBasicMaterial({ color: new Color(1, 0, 0) }));
  square.position.z = -NEAR;
  scene.add(wall, square);
  const scenePass = pass(scene, camera, { samples: 0 });
  scenePass.setMRT(mrt({ output, velocity }));
  const lens = new LensNode(scenePass, { libraries: await Promise.all(libraries.map((one) => readLibrary(bytes(one)))), velocity: scenePass.getTextureNode("velocity") });
  const pipeline = new RenderPipeline(renderer);
  pipeline.outputColorTransform = false;
  pipeline.outputNode = lens;
  const target = new RenderTarget(SIZE, SIZE, { type: FloatType });

  async function draw({ enabled, blur, speed }: ThreeRequest): Promise<number[]> {
    lens.enabled = enabled;
    // s = F · R · (1/z_f − 1/z): R = blur / 24 units.
    const focal = 0.004;
    const image = (focal * FAR) / (FAR - focal);
    const radius = Math.max(blur, 1e-9) / (PIXELS_PER_UNIT * (1 / NEAR - 1 / FAR));
    Object.assign(lens.lens, { focus: FAR, focal, sensor: 2 * image, fstop: focal / 2 / radius, shutter: 1 });
    // Nodes are brought up to date once a frame, and frames are counted by the animation loop.
    await new Promise<void>((resolve) => {
      let frame = 0;
      renderer.setAnimationLoop(() => {
        if (frame > 2) return;
        square.position.x = ((frame - 2) * speed) / PIXELS_PER_UNIT;
        renderer.setRenderTarget(target);
        pipeline.render();
        if (++frame > 2) resolve();
      });
    });
    renderer.setAnimationLoop(null);
    const data = (await renderer.readRenderTargetPixelsAsync(target, 0, 0, SIZE, SIZE)) as Float32Array;
    return Array.from({ length: SIZE }, (_, x) => data[4 * (PIXELS_PER_UNIT * SIZE + x)]!);
  }

  function dispose(): number {
    lens.dispose();
    pipeline.dispose();
    renderer.dispose();
    return alive;
  }

  return { draw, dispose };
}

const stands = new Map<boolean, Promise<Stand>>();

/** Red of the middle row, after three frames. */
async function draw(request: ThreeRequest): Promise<number[]> {
  const { libraries, reversed } = request;
  if (!stands.has(reversed)) stands.set(reversed, makeStand(libraries, reversed));
  return (await stands.get(reversed)!).draw(request);
}

/** Free everything; says how many buffers of the lens are left of how many stands. */
async function dispose(): Promise<{ left: number; stands: number }> {
  const made = await Promise.all(stands.values());
  return { left: made.reduce((sum, stand) => sum + stand.dispose(), 0), stands: made.length };
}

declare global {
  interface Window {
    lensThree(request: ThreeRequest): Promise<number[]>;
    lensThreeDispose(): Promise<{ left: number; stands: number }>;
    lensThreeReady: boolean;
  }
}
window.lensThree = draw;
window.lensThreeDispose = dispose;
window.lensThreeReady = true;
