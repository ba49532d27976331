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

/** Red of the middle row, after three frames; and whether the node freed what it made. */
async function draw({ libraries, reversed, enabled, blur, speed }: ThreeRequest): Promise<{ row: number[]; left: number }> {
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
  // One unit is 32 px at distance 1: tan(fov/2) = 1.
  const camera = new PerspectiveCamera(90, 1, 0.1, 100);
  const scene = new Scene();
  const wall = new Mesh(new PlaneGeometry(20, 20), new MeshBasicMaterial({ color: new Color(0, 0, 1) }));
  wall.position.z = -4;
  const square = new Mesh(new PlaneGeometry(0.5, 0.5), new MeshBasicMaterial({ color: new Color(1, 0, 0) }));
  square.position.z = -1;
  scene.add(wall, square);
  const scenePass = pass(scene, camera, { samples: 0 });
  scenePass.setMRT(mrt({ output, velocity }));
  const lens = new LensNode(scenePass, { libraries: await Promise.all(libraries.map((one) => readLibrary(bytes(one)))), velocity: scenePass.getTextureNode("velocity") });
  lens.enabled = enabled;
  // s = F · R · (1/z_f − 1/z) with F = 32 px, z = 1, z_f = 4: R = blur / 24 units.
  const focal = 0.004;
  const image = (focal * 4) / (4 - focal);
  Object.assign(lens.lens, { focus: 4, focal, sensor: 2 * image, fstop: focal / 2 / (Math.max(blur, 1e-9) / 24), shutter: 1 });
  const pipeline = new RenderPipeline(renderer);
  pipeline.outputColorTransform = false;
  pipeline.outputNode = lens;
  const target = new RenderTarget(SIZE, SIZE, { type: FloatType });
  // Nodes are brought up to date once a frame, and frames are counted by the animation loop.
  await new Promise<void>((resolve) => {
    let frame = 0;
    renderer.setAnimationLoop(() => {
      if (frame > 2) return;
      square.position.x = ((frame - 2) * speed) / 32;
      renderer.setRenderTarget(target);
      pipeline.render();
      if (++frame > 2) resolve();
    });
  });
  renderer.setAnimationLoop(null);
  const data = (await renderer.readRenderTargetPixelsAsync(target, 0, 0, SIZE, SIZE)) as Float32Array;
  const row = Array.from({ length: SIZE }, (_, x) => data[4 * (32 * SIZE + x)]!);
  lens.dispose();
  pipeline.dispose();
  renderer.dispose();
  return { row, left: alive };
}

declare global {
  interface Window {
    lensThree(request: ThreeRequest): Promise<{ row: number[]; left: number }>;
    lensThreeReady: boolean;
  }
}
window.lensThree = draw;
window.lensThreeReady = true;
