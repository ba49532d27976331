/** Textures and uniforms of materials are summed up against what a renderer offers, before any shader is built. */

import { LearnedScene, LightwellLoaderPlugin, parseLearned } from "lightwell";
import { type DeviceOwner, LearnedNodeScene } from "lightwell/webgpu";
import { Mesh, MeshStandardMaterial, Texture, type WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { describe, expect, it } from "vitest";
import { linearField, plainRoom, stillField } from "./support/fixtures.ts";
import { type Fixture, type FixtureField, writeGlb } from "./support/glb.ts";

const load = (change: Partial<Fixture> = {}) =>
  parseLearned(
    new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser)),
    writeGlb(plainRoom(change)).buffer,
  );
/** A renderer as far as the sums look at it. */
const offering = (maxTextures: number, maxFragmentUniforms = 224) => {
  const gl = { getExtension: () => null, getParameter: () => "a GPU", RENDERER: 0 };
  return { capabilities: { maxTextures, maxFragmentUniforms }, getContext: () => gl } as unknown as WebGLRenderer;
};

/** A field whose layer the light writes: `blocks` vectors of per-frame values. */
function framedField(blocks: number): FixtureField {
  const width = 4 * blocks;
  return {
    role: "indirect",
    variable: 0,
    graph: {
      version: 1,
      inputs: { position: 3, light: 3 },
      buffers: {
        w: { shape: [width, 3], type: "float32", values: new Float32Array(3 * width) },
        b: { shape: [width], type: "float32", values: new Float32Array(width) },
      },
      nodes: [
        { id: "m", op: "linear", inputs: ["light"], weights: "w", bias: "b", per_frame: true },
        { id: "part", op: "slice", inputs: ["m"], start: 0, width: 3 },
        { id: "y", op: "add", inputs: ["part", "position"] },
      ],
      outputs: { radiance: "y" },
    },
  };
}

/** A field of about 0.6 MB of literals. */
function wideField(): FixtureField {
  const width = 200;
  return {
    role: "static",
    graph: {
      version: 1,
      inputs: { position: 3 },
      buffers: {
        w: { shape: [width, 3], type: "float32", values: new Float32Array(3 * width) },
        b: { shape: [width], type: "float32", values: new Float32Array(width) },
        v: { shape: [width, width], type: "float32", values: Float32Array.from({ length: width * width }, (_, i) => Math.sin(i)) },
      },
      nodes: [
        { id: "a", op: "linear", inputs: ["position"], weights: "w", bias: "b" },
        { id: "c", op: "linear", inputs: ["a"], weights: "v", bias: "b" },
        { id: "y", op: "slice", inputs: ["c"], start: 0, width: 3 },
      ],
      outputs: { radiance: "y" },
    },
  };
}

/** A `WebGPURenderer` as far as the sums look at it. */
const device = (textures: number, vectors = 4096): DeviceOwner => ({
  backend: {
    isWebGPUBackend: true,
    device: { limits: { maxSampledTexturesPerShaderStage: textures, maxSamplersPerShaderStage: 16, maxUniformBufferBindingSize: 16 * vectors } },
  },
});
const fallback = (textures: number, vectors = 4096): DeviceOwner => {
  const gl = { MAX_TEXTURE_IMAGE_UNITS: 1, MAX_UNIFORM_BLOCK_SIZE: 2, getParameter: (name: number) => (name === 1 ? textures : 16 * vectors) };
  return { backend: { gl, isWebGPUBackend: false } };
};

type Loaded = Awaited<ReturnType<typeof load>>;
type Weights = { weights?: "inline" | "texture" };
/** Each adapter on a device with so many textures and uniform vectors. */
const ADAPTERS = {
  "WebGL 2": (gltf: Loaded, options: Weights, textures: number, vectors?: number) =>
    new LearnedScene(gltf, { ...options, renderer: offering(textures, vectors) }),
  WebGPU: (gltf: Loaded, options: Weights, textures: number, vectors?: number) =>
    new LearnedNodeScene(gltf, { ...options, renderer: device(textures, vectors) }),
  "WebGPURenderer on WebGL 2": (gltf: Loaded, options: Weights, textures: number, vectors?: number) =>
    new LearnedNodeScene(gltf, { ...options, renderer: fallback(textures, vectors) }),
};

describe.each(Object.entries(ADAPTERS))("checkMaterials of %s", (_, create) => {
  it("counts a material's maps, shadow maps and tables", async () => {
    const gltf = await load({ fields: [linearField()] });
    gltf.scene.traverse((object) => {
      if (!(object instanceof Mesh)) return;
      const material = object.material as MeshStandardMaterial;
      material.name = "wall";
      material.map = material.normalMap = new Texture();
      material.roughnessMap = new Texture();
    });
    const own = new Set<unknown>();
    gltf.scene.traverse((object) => {
      if (object instanceof Mesh) own.add(object.material);
    });
    // Two maps, the table of three.js, one shadow map, one table of weights.
    expect(() => create(gltf, { weights: "texture" }, 4)).toThrow(
      /^material 'wall': expected at most 4 textures on this device, found 5 \(its own 2, of three.js 1, shadow maps 1, learned light 1\); use fewer lamps or maps$/,
    );
    // What is refused is left as it was loaded.
    gltf.scene.traverse((object) => {
      if (object instanceof Mesh) expect(own).toContain(object.material);
    });
    expect(() => create(gltf, { weights: "texture" }, 5)).not.toThrow();
  });

  it("counts uniforms", async () => {
    const gltf = await load({ fields: [linearField(), stillField()] });
    expect(() => create(gltf, {}, 16, 40)).toThrow(/^fields: expected at most 40 uniform vectors on this device, found 64; use fewer lamps or fields$/);
    expect(() => create(gltf, {}, 16)).not.toThrow();
  });

  it("adds up the text of all fields", async () => {
    const two = await load({ fields: [wideField(), wideField()] });
    expect(() => create(two, { weights: "texture" }, 16)).not.toThrow();
    expect(() => create(two, { weights: "inline" }, 16)).toThrow(/^fields: expected at most 1000000 characters of shader text/);
  });
});

describe("without a renderer", () => {
  it("WebGPU takes what every device offers", async () => {
    const gltf = await load({ fields: Array.from({ length: 8 }, linearField) });
    const wall = (gltf.scene.getObjectByProperty("isMesh", true) as Mesh).material as MeshStandardMaterial;
    // Eight tables of weights, a shadow map, and the table of three.js.
    for (const name of ["map", "normalMap", "roughnessMap", "metalnessMap", "aoMap", "emissiveMap"] as const) wall[name] = new Texture();
    new LearnedNodeScene(gltf, { weights: "texture" }).detach();
    wall.bumpMap = new Texture();
    expect(() => new LearnedNodeScene(gltf, { weights: "texture" })).toThrow(/at most 16 textures on this device, found 17/);
  });

  it("WebGL fields share a fixed part of the uniforms for what lamps alone decide", async () => {
    const framed = (count: number) => Array.from({ length: count }, () => framedField(30));
    const demandsOf = async (count: number) => new LearnedScene(await load({ fields: framed(count) })).fields.map((field) => field.demand);
    expect(await demandsOf(4)).toEqual(Array(4).fill(expect.objectContaining({ textures: 0, uniforms: 32 })));
    expect(await demandsOf(5)).toEqual(Array(5).fill(expect.objectContaining({ textures: 1, uniforms: 2 })));
  });
});
