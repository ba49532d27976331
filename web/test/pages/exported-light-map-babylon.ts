/** Babylon.js with the light map that `lightwell export --to babylon` wrote, without lamps. */

import { FreeCamera } from "@babylonjs/core/Cameras/freeCamera.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import { ImportMeshAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import type { PBRMaterial } from "@babylonjs/core/Materials/PBR/pbrMaterial.js";
import { Color3, Color4 } from "@babylonjs/core/Maths/math.color.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { Scene } from "@babylonjs/core/scene.js";
import "@babylonjs/loaders/glTF/index.js";
import { bytesOf, type Frame, publish, read } from "./exported-light-map.ts";

type Apply = (scene: Scene, folder: string) => Promise<unknown>;

export function show(applyLightMap: Apply): void {
  publish(async (frame: Frame) => {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = frame.size;
    const engine = new Engine(canvas, false, { preserveDrawingBuffer: true });
    const scene = new Scene(engine);
    scene.clearColor = new Color4(0, 0, 0, 1);
    const { meshes } = await ImportMeshAsync(new File([bytesOf(frame)], "scene.glb"), scene);
    for (const light of scene.lights) light.setEnabled(false);
    for (const material of scene.materials as PBRMaterial[]) material.emissiveColor = Color3.Black();
    await applyLightMap(scene, frame.folder);
    const camera = new FreeCamera("camera", Vector3.Zero(), scene);
    const toWorld = meshes[0]!.computeWorldMatrix(true);
    camera.position = Vector3.TransformCoordinates(new Vector3(...frame.position), toWorld);
    camera.setTarget(Vector3.TransformCoordinates(new Vector3(...frame.target), toWorld));
    camera.fov = (frame.fov * Math.PI) / 180;
    [camera.minZ, camera.maxZ] = [frame.near, frame.far];
    await scene.whenReadyAsync();
    scene.render();
    scene.render();
    return read(engine._gl as WebGL2RenderingContext, frame.size);
  });
}
