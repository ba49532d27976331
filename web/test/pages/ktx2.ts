/** Loads a file whose ordinary light map is a KTX2 texture, with three's own decoder, which the plug-in brings. */

import { learnedLight, LightwellLoaderPlugin } from "lightwell";
import { WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

declare global {
  interface Window {
    /** The light maps of a GLB: size, first texel as stored, colour space, set of texture coordinates. */
    lightmapsOf(base64: string): Promise<{ size: number[]; texel: number[]; colorSpace: string; channel: number }[]>;
  }
}

window.lightmapsOf = async (base64) => {
  const renderer = new WebGLRenderer();
  const loader = new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser, { renderer }));
  const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  const gltf = await loader.parseAsync(bytes.buffer, "");
  const found = [...learnedLight(gltf).lightmaps.values()].map(({ map }) => {
    const image = map.image as { width: number; height: number; data?: Uint8Array };
    const [mipmap] = (map.mipmaps ?? []) as { data: Uint8Array }[];
    const texels = image.data ?? mipmap!.data;
    return { size: [image.width, image.height], texel: [...texels.slice(0, 4)], colorSpace: map.colorSpace, channel: map.channel };
  });
  renderer.dispose();
  return found;
};
