/** Loads files with KTX2 textures by three's own decoder, which the plug-in brings. */

import { learnedLight, LightwellLoaderPlugin } from "lightwell";
import { type CompressedTexture, GLSL3, Mesh, OrthographicCamera, PlaneGeometry, RawShaderMaterial, Scene, WebGLRenderer, WebGLRenderTarget } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { pictureTexture } from "../../runtime/src/learned-field.ts";

declare global {
  interface Window {
    /** The light maps of a GLB: size, first texel as stored, colour space, set of texture coordinates. */
    lightmapsOf(base64: string): Promise<{ size: number[]; texel: number[]; colorSpace: string; channel: number }[]>;
    /** The pictures that the field of a GLB reads, each level as the GPU gives it: RGBA of texel after texel, row 0 first. */
    picturesOf(base64: string, compressed: boolean): Promise<Record<string, { format: number; minFilter: number; levels: number[][] }>>;
    /** What a loader without a renderer says of a GLB. */
    withoutDecoder(base64: string): Promise<string>;
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

const FRAGMENT = `precision highp float;
uniform sampler2D picture;
uniform int level;
out vec4 texel;
void main() { texel = texelFetch(picture, ivec2(gl_FragCoord.xy), level); }`;
const VERTEX = "in vec3 position; void main() { gl_Position = vec4(position, 1.0); }";

/** Texels of a level of a texture, read by a shader. */
function fetched(renderer: WebGLRenderer, texture: CompressedTexture, level: number): number[] {
  const { width, height } = texture.mipmaps[level]!;
  const target = new WebGLRenderTarget(width, height);
  const uniforms = { picture: { value: texture }, level: { value: level } };
  const material = new RawShaderMaterial({ glslVersion: GLSL3, vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms });
  renderer.setRenderTarget(target);
  renderer.render(new Scene().add(new Mesh(new PlaneGeometry(2, 2), material)), new OrthographicCamera());
  const bytes = new Uint8Array(4 * width * height);
  renderer.readRenderTargetPixels(target, 0, 0, width, height, bytes);
  return [...bytes];
}

/** A renderer of a GPU that takes no compressed texture. */
const PLAIN = { extensions: { has: () => false, get: () => null } } as unknown as WebGLRenderer;

const loaded = (base64: string, options: { renderer?: WebGLRenderer }) => {
  const loader = new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser, options));
  return loader.parseAsync(Uint8Array.from(atob(base64), (c) => c.charCodeAt(0)).buffer, "");
};

window.picturesOf = async (base64, compressed) => {
  const renderer = new WebGLRenderer();
  const gltf = await loaded(base64, { renderer: compressed ? renderer : PLAIN });
  const [field] = learnedLight(gltf).fields;
  const found: Record<string, { format: number; minFilter: number; levels: number[][] }> = {};
  for (const [name, buffer] of field!.buffers) {
    if (!buffer.picture) continue;
    const texture = pictureTexture(buffer) as CompressedTexture;
    const levels = texture.mipmaps.map((_, level) => fetched(renderer, texture, level));
    found[name] = { format: texture.format, minFilter: texture.minFilter, levels };
  }
  renderer.dispose();
  return found;
};

window.withoutDecoder = (base64) => loaded(base64, {}).then(() => "loaded", (error: Error) => error.message);
