/** A pane of clear glass with nothing behind it, on a canvas that is not opaque. */

import { clearBehindGlass } from "lightwell";
import { Mesh, MeshPhysicalMaterial, PerspectiveCamera, PlaneGeometry, Scene, WebGLRenderer } from "three";

const SIZE = 16;

function middle(cleared: boolean): number[] {
  const renderer = new WebGLRenderer({ canvas: document.createElement("canvas"), alpha: true });
  renderer.setSize(SIZE, SIZE, false);
  renderer.setClearColor(0, 0);
  if (cleared) clearBehindGlass(renderer);
  const scene = new Scene();
  scene.add(new Mesh(new PlaneGeometry(4, 4), new MeshPhysicalMaterial({ transmission: 1, roughness: 0 })));
  const camera = new PerspectiveCamera(40, 1, 0.1, 10);
  camera.position.z = 2;
  renderer.render(scene, camera);
  const gl = renderer.getContext();
  const pixel = new Uint8Array(4);
  gl.readPixels(SIZE / 2, SIZE / 2, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  renderer.dispose();
  return [...pixel];
}

Object.assign(window, { behindGlass: { middle } });
