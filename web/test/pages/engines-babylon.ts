/** Babylon.js draws the same. */

import { FreeCamera } from "@babylonjs/core/Cameras/freeCamera.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import { ImportMeshAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import { Color4 } from "@babylonjs/core/Maths/math.color.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { Scene } from "@babylonjs/core/scene.js";
import "@babylonjs/loaders/glTF/index.js";
import { learnedLight, registerLearnedLight } from "lightwell/babylon";
import { CAMERA, glb, publish, SIZE } from "./engines-shot.ts";

registerLearnedLight();
const [width, height] = SIZE;
const canvas = document.createElement("canvas");
[canvas.width, canvas.height] = SIZE;
const engine = new Engine(canvas, false, { preserveDrawingBuffer: true });

publish(async ({ light, parts }) => {
  const scene = new Scene(engine);
  scene.clearColor = new Color4(0, 0, 0, 1);
  scene.useRightHandedSystem = document.body.dataset.hand === "right";
  const { meshes } = await ImportMeshAsync(new File([glb()], "scene.glb"), scene);
  const learned = learnedLight(meshes[0]!)!;
  const camera = new FreeCamera("camera", Vector3.Zero(), scene);
  // Without right-handed axes, Babylon.js turns files about and mirrors them: points of the file go through the root.
  const toWorld = meshes[0]!.computeWorldMatrix(true);
  camera.position = Vector3.TransformCoordinates(new Vector3(...CAMERA.position), toWorld);
  camera.setTarget(Vector3.TransformCoordinates(new Vector3(...CAMERA.target), toWorld));
  camera.fov = (CAMERA.fov * Math.PI) / 180;
  [camera.minZ, camera.maxZ] = [0.05, 50];
  if (light) learned.lamps[0]!.object.position.set(...light);
  learned.show(parts);
  await scene.whenReadyAsync();
  scene.render();
  scene.render();
  const gl = engine._gl as WebGL2RenderingContext;
  const read = () => {
    const rows = new Uint8Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rows);
    return rows;
  };
  const rows = read();
  // Without its light the file is there still, and dark.
  learned.dispose();
  await scene.whenReadyAsync();
  scene.render();
  const dark = Math.max(...read().filter((_, i) => i % 4 < 3));
  if (dark > 8) throw new Error(`expected nothing lit after dispose, found ${dark}`);
  scene.dispose();
  return rows;
});
