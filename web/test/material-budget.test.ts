/** Textures and uniforms of materials are summed up against what a renderer offers. */

import { LearnedScene, LightwellLoaderPlugin, parseLearned } from "lightwell";
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

describe("checkMaterials", () => {
  it("counts a material's maps, shadow maps and tables", async () => {
    const gltf = await load({ fields: [linearField()] });
    gltf.scene.traverse((object) => {
      if (!(object instanceof Mesh)) return;
      const material = object.material as MeshStandardMaterial;
      material.name = "wall";
      material.map = material.normalMap = new Texture();
      material.roughnessMap = new Texture();
    });
    // Two maps, one shadow map, one table of weights.
    expect(() => new LearnedScene(gltf, { weights: "texture", renderer: offering(4) })).not.toThrow();
    expect(() => new LearnedScene(gltf, { weights: "texture", renderer: offering(3) })).toThrow(
      /material 'wall': expected at most 3 textures on this device, found 4 \(its own 2, shadow maps 1, learned light 1\); use fewer/,
    );
  });

  it("counts uniforms, of which many fields share a fixed part", async () => {
    const gltf = await load({ fields: [linearField(), stillField()] });
    expect(() => new LearnedScene(gltf, { renderer: offering(16, 40) })).toThrow(/at most 40 uniform vectors on this device, found \d+/);
    const framed = (count: number) => Array.from({ length: count }, () => framedField(30));
    const [few, many] = [new LearnedScene(await load({ fields: framed(4) })), new LearnedScene(await load({ fields: framed(5) }))];
    expect(few.fields.map((field) => [field.samplers, field.uniformVectors])).toEqual(Array(4).fill([0, 32]));
    expect(many.fields.map((field) => [field.samplers, field.uniformVectors])).toEqual(Array(5).fill([1, 2]));
    expect(() => new LearnedScene(gltf, { renderer: offering(16) })).not.toThrow();
  });

  it("adds up the text of all fields", async () => {
    const width = 200;
    const wide: FixtureField = {
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
    const two = await load({ fields: [wide, { ...wide }] });
    expect(() => new LearnedScene(two, { weights: "texture" })).not.toThrow();
    expect(() => new LearnedScene(two, { weights: "inline" })).toThrow(/fields: expected at most 1000000 characters of shader text/);
  });
});
