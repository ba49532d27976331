/** The eye: a perspective camera on an orbit, which keeps a framed picture whole on any canvas. */

import { clippingPlanes } from "lightwell";
import { type Box3, MathUtils, MOUSE, PerspectiveCamera, Vector3 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { CameraData } from "./page-data.ts";

/** Camera, orbit controls, and the aspect of the picture that must stay visible. */
export class CameraRig {
  readonly camera = new PerspectiveCamera();
  readonly controls: OrbitControls;
  private fovY = 45;
  /** Width ÷ height of the picture that must stay whole. */
  private frameAspect = 1;
  private canvasAspect = 1;
  /** Diagonal of what is looked at, metres. */
  private size = 1;

  constructor(canvas: HTMLElement) {
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.12;
    this.controls.zoomToCursor = true;
    this.controls.mouseButtons = { LEFT: MOUSE.ROTATE, MIDDLE: MOUSE.DOLLY, RIGHT: MOUSE.PAN };
  }

  /** Distances that suit a scene. Args: the part that is looked at; all of it. */
  fit(core: Box3, bounds: Box3): void {
    const size = Math.max(core.getSize(new Vector3()).length(), 1e-6);
    this.size = size;
    [this.camera.near, this.camera.far] = clippingPlanes(core, bounds);
    this.controls.minDistance = size * 5e-3;
    this.controls.maxDistance = size * 10;
  }

  /** Look as `data` says; `aspect` is that of the picture to keep whole. */
  place(data: CameraData, aspect: number): void {
    this.fovY = data.fovY;
    this.frameAspect = aspect;
    this.camera.up.set(...data.up).normalize();
    this.camera.position.set(...data.position);
    this.controls.target.set(...data.target);
    this.settle();
    this.project(this.canvasAspect);
  }

  /** Eye, target and field of view as they are now. */
  placed(): { position: [number, number, number]; target: [number, number, number]; fovY: number } {
    return { position: this.camera.position.toArray(), target: this.controls.target.toArray(), fovY: this.camera.fov };
  }

  /** Move eye and target along the axes of the eye (right, up, ahead; shares of the diagonal of what is looked at), and turn by radians. */
  fly([right, up, ahead]: readonly [number, number, number], turn: number): void {
    const { camera, controls, size } = this;
    const step = new Vector3(right, up, -ahead).applyQuaternion(camera.quaternion).multiplyScalar(size);
    const view = controls.target.clone().sub(camera.position).applyAxisAngle(camera.up, turn);
    camera.position.add(step);
    controls.target.copy(camera.position).add(view);
    this.settle();
  }

  /** Turn the eye by radians about the upright axis through what it looks at. */
  orbit(turn: number): void {
    const { camera, controls } = this;
    const away = camera.position.clone().sub(controls.target).applyAxisAngle(camera.up, turn);
    camera.position.copy(controls.target).add(away);
    this.settle();
  }

  /** End a glide, so that the next frame shows the camera where it was placed. */
  private settle(): void {
    this.controls.enableDamping = false;
    this.controls.update();
    this.controls.enableDamping = true;
  }

  /** Set the projection for a canvas; a canvas narrower than the frame sees more above and below. */
  project(canvasAspect: number): void {
    this.canvasAspect = canvasAspect;
    const widen = Math.max(1, this.frameAspect / canvasAspect);
    const half = Math.atan(Math.tan(MathUtils.degToRad(this.fovY) / 2) * widen);
    this.camera.fov = MathUtils.radToDeg(2 * half);
    this.camera.aspect = canvasAspect;
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
  }

  /** A camera for exactly the framed picture. */
  frameCamera(): PerspectiveCamera {
    const camera = this.camera.clone();
    camera.fov = this.fovY;
    camera.aspect = this.frameAspect;
    camera.updateProjectionMatrix();
    return camera;
  }

  /** Where the framed picture lies on the canvas, in its uv: corner and size. */
  frame(): [number, number, number, number] {
    const width = Math.min(1, this.frameAspect / this.canvasAspect);
    const height = Math.min(1, this.canvasAspect / this.frameAspect);
    return [(1 - width) / 2, (1 - height) / 2, width, height];
  }

  dispose(): void {
    this.controls.dispose();
  }
}

/** A camera that sees the whole of a box. */
export function overview(bounds: Box3): CameraData {
  const center = bounds.getCenter(new Vector3());
  const radius = Math.max(bounds.getSize(new Vector3()).length() / 2, 1e-6);
  const fovY = 40;
  const distance = (radius / Math.sin(MathUtils.degToRad(fovY) / 2)) * 0.95;
  const eye = new Vector3(0.35, 0.25, 1).normalize().multiplyScalar(distance).add(center);
  return { position: [eye.x, eye.y, eye.z], target: [center.x, center.y, center.z], up: [0, 1, 0], fovY };
}
