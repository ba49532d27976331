/** The light of the file as lightwell's own runtime shows it: learned light alone, as sRGB without tone mapping. */

import { LearnedScene, LightwellLoaderPlugin } from "lightwell";
import { NoToneMapping, PerspectiveCamera, Scene, SRGBColorSpace, WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { bytesOf, type Frame, publish, read } from "./exported-light-map.ts";

publish(async (frame: Frame) => {
  const renderer = new WebGLRenderer({ canvas: document.createElement("canvas"), antialias: false });
  renderer.setSize(...frame.size, false);
  renderer.toneMapping = NoToneMapping;
  renderer.outputColorSpace = SRGBColorSpace;
  const gltf = await new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser)).parseAsync(bytesOf(frame), "");
  const learned = new LearnedScene(gltf, { renderer });
  const scene = new Scene();
  scene.add(learned.root);
  const camera = new PerspectiveCamera(frame.fov, frame.size[0] / frame.size[1], frame.near, frame.far);
  camera.position.set(...frame.position);
  camera.lookAt(...frame.target);
  learned.show({ raster: false, indirect: true, still: true });
  learned.update();
  await learned.compile(renderer, scene, camera);
  renderer.render(scene, camera);
  return read(renderer.getContext() as WebGL2RenderingContext, frame.size);
});
