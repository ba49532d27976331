/** three.js with the light map that `lightwell export --to threejs` wrote, without lamps. */

import { type Light, type Mesh, type MeshStandardMaterial, NoToneMapping, type Object3D, PerspectiveCamera, Scene, SRGBColorSpace, WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { bytesOf, type Frame, publish, read } from "./exported-light-map.ts";

type Apply = (root: Object3D, folder: string) => Promise<unknown>;

export function show(applyLightMap: Apply): void {
  publish(async (frame: Frame) => {
    const renderer = new WebGLRenderer({ canvas: document.createElement("canvas"), antialias: false });
    renderer.setSize(...frame.size, false);
    renderer.toneMapping = NoToneMapping;
    renderer.outputColorSpace = SRGBColorSpace;
    const { scene: root } = await new GLTFLoader().parseAsync(bytesOf(frame), "");
    root.traverse((object) => {
      if ((object as Light).isLight) (object as Light).intensity = 0;
      const material = (object as Mesh).material as MeshStandardMaterial | undefined;
      material?.emissive?.set(0);
    });
    const scene = new Scene();
    scene.add(root);
    await applyLightMap(root, frame.folder);
    const camera = new PerspectiveCamera(frame.fov, frame.size[0] / frame.size[1], frame.near, frame.far);
    camera.position.set(...frame.position);
    camera.lookAt(...frame.target);
    renderer.render(scene, camera);
    return read(renderer.getContext() as WebGL2RenderingContext, frame.size);
  });
}
