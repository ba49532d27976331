/** The picture of three.js that other engines are held against: linear light as sRGB, clipped. */

import { LearnedScene, LightwellLoaderPlugin } from "lightwell";
import { NoToneMapping, PerspectiveCamera, Scene, SRGBColorSpace, Vector3, WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { CAMERA, glb, publish, SIZE, type Shot } from "./engines-shot.ts";

const [width, height] = SIZE;
const renderer = new WebGLRenderer({ canvas: document.createElement("canvas"), antialias: false });
renderer.setSize(width, height, false);
renderer.shadowMap.enabled = true;
renderer.toneMapping = NoToneMapping;
renderer.outputColorSpace = SRGBColorSpace;

publish(async ({ light, parts }: Shot) => {
  const gltf = await new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser)).parseAsync(glb(), "");
  const learned = new LearnedScene(gltf, { renderer });
  const scene = new Scene();
  scene.add(learned.root);
  const camera = new PerspectiveCamera(CAMERA.fov, width / height, 0.05, 50);
  camera.position.set(...CAMERA.position);
  camera.lookAt(...CAMERA.target);
  if (light) learned.lamps[0]!.move(new Vector3(...light));
  learned.show(parts);
  learned.update();
  await learned.compile(renderer, scene, camera);
  renderer.render(scene, camera);
  const gl = renderer.getContext();
  const rows = new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rows);
  learned.dispose();
  return rows;
});
