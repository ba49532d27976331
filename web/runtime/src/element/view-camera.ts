/** Where an element looks from. */

import { type Box3, PerspectiveCamera, Vector3 } from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import { clippingPlanes } from "../core.ts";
import { vectors } from "./attributes.ts";

const FIELD_OF_VIEW = 40;

/** A scene: all of it, and the part that is looked at. */
interface Extent {
  readonly bounds: Box3;
  readonly core: Box3;
}

/**
 * Put a camera where an element's attribute `camera` says: at the camera of the file with this name, at "eye / target", at the first
 * camera of the file, or where the whole scene is seen.
 *
 * Returns the point that it looks at.
 */
export function placeCamera(camera: PerspectiveCamera, asked: string | null, gltf: GLTF, { bounds, core }: Extent): Vector3 {
  const size = Math.max(core.getSize(new Vector3()).length(), 1e-6);
  const center = core.getCenter(new Vector3());
  const own = gltf.cameras.filter((found) => found instanceof PerspectiveCamera);
  const named = own.find(({ name }) => name === asked);
  const places = named ? null : vectors(asked);
  const file = named ?? (places ? undefined : own[0]);
  [camera.near, camera.far] = clippingPlanes(core, bounds);
  camera.fov = file?.fov ?? FIELD_OF_VIEW;
  const [eye, target] = file ? seenBy(file, center) : (places ?? overview(center, size));
  camera.position.copy(eye!);
  camera.updateProjectionMatrix();
  return target ?? center;
}

/** Eye and target of a camera of the file: as far ahead as the middle of the scene is. */
function seenBy(file: PerspectiveCamera, center: Vector3): [Vector3, Vector3] {
  file.updateWorldMatrix(true, false);
  const eye = new Vector3().setFromMatrixPosition(file.matrixWorld);
  const ahead = file.getWorldDirection(new Vector3());
  const distance = Math.max(center.clone().sub(eye).dot(ahead), 0.1 * center.distanceTo(eye), 1e-3);
  return [eye, eye.clone().addScaledVector(ahead, distance)];
}

function overview(center: Vector3, size: number): [Vector3, Vector3] {
  const away = (0.95 * size) / (2 * Math.sin((FIELD_OF_VIEW * Math.PI) / 360));
  return [center.clone().addScaledVector(new Vector3(0.35, 0.25, 1).normalize(), away), center];
}
