/** Learned light in Babylon.js: register once, load as ever. */

import { ArcRotateCamera } from "@babylonjs/core/Cameras/arcRotateCamera.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import { ImportMeshAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { Scene } from "@babylonjs/core/scene.js";
import "@babylonjs/loaders/glTF/index.js";
import { learnedLight, registerLearnedLight } from "lightwell/babylon";

registerLearnedLight();
const canvas = document.querySelector("canvas")!;
const engine = new Engine(canvas, true);
const scene = new Scene(engine);
const { meshes } = await ImportMeshAsync("scene.glb", scene);
const [lamp] = learnedLight(meshes[0]!)!.lamps;

const { min, max } = meshes[0]!.getHierarchyBoundingVectors();
const camera = new ArcRotateCamera("camera", Math.PI / 2, 1.4, 1.1 * max.subtract(min).length(), Vector3.Center(min, max), scene);
camera.attachControl(canvas);
const home = lamp?.object.position.clone();
scene.onBeforeRenderObservable.add(() => {
  // A light of Babylon.js as any other; it stays inside the box in which its light was learned.
  if (lamp && home) lamp.object.position = home.add(new Vector3(Math.sin(performance.now() / 1500), 0, 0).scale(0.3));
});
engine.runRenderLoop(() => scene.render());
addEventListener("resize", () => engine.resize());
