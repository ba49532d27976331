/** What is put on a material in place, as its owner sees it: chained hooks, and materials that several objects share. */

import { Bone, DoubleSide, FrontSide, InstancedMesh, Mesh, MeshStandardMaterial, Object3D, ShaderLib, Skeleton, SkinnedMesh } from "three";
import { describe, expect, it } from "vitest";
import type { SurfaceFinish } from "../runtime/src/surface-finish.ts";
import { type Finisher, SurfaceMaterials } from "../runtime/src/surface-materials.ts";
import { SurfacePatch } from "../runtime/src/surface-patch.ts";
import { NodePatch } from "../runtime/src/webgpu/node-patch.ts";

const FINISH: SurfaceFinish = {
  key: () => "finish",
  uniforms: () => ({}),
  readsUv: false,
  environment: true,
  functions: () => "/* finish */",
  statements: "",
};
/** A renderer as far as a shader is finished for it. */
const RENDERER = { getContext: () => ({ getExtension: () => null, getParameter: () => "a GPU" }) } as never;

/** The shader of a material as three.js asks for it, and how often it was finished. */
function compiled(material: MeshStandardMaterial): { text: string; finished: number } {
  const { vertexShader, fragmentShader } = ShaderLib.physical;
  const shader = { uniforms: {}, vertexShader, fragmentShader };
  material.onBeforeCompile(shader as never, RENDERER);
  return { text: shader.fragmentShader, finished: shader.fragmentShader.split("/* finish */").length - 1 };
}

/** Put a hook and a key on a material as three.js' users do: around those that are there. */
function chain(material: MeshStandardMaterial, name: string): void {
  const [hook, key] = [material.onBeforeCompile, material.customProgramCacheKey];
  material.onBeforeCompile = (shader, renderer) => {
    hook.call(material, shader, renderer);
    shader.fragmentShader += `\n// ${name}`;
  };
  material.customProgramCacheKey = () => `${key.call(material)}+${name}`;
}

const hooksOf = (text: string) => text.match(/(?<=^\/\/ )hook \d$/gm) ?? [];

describe("a finish beside hooks of the owner", () => {
  it("is called once where a hook calls the one that it found, which may do the same", () => {
    const material = new MeshStandardMaterial();
    chain(material, "hook 1");
    const patch = new SurfacePatch(material, FINISH);
    for (const name of ["hook 2", "hook 3"]) chain(material, name);
    const { text, finished } = compiled(material);
    expect([hooksOf(text), finished]).toEqual([["hook 1", "hook 2", "hook 3"], 1]);
    expect(material.customProgramCacheKey()).toMatch(/\+hook 1\+hook 2\+hook 3\|lightwell:finish$/);
    patch.restore();
    expect(material.customProgramCacheKey()).toMatch(/\+hook 1\+hook 2\+hook 3$/);
    expect([hooksOf(compiled(material).text), compiled(material).finished]).toEqual([["hook 1", "hook 2", "hook 3"], 0]);
    // Put on again, as by `attach`.
    new SurfacePatch(material, FINISH);
    expect([hooksOf(compiled(material).text), compiled(material).finished]).toEqual([["hook 1", "hook 2", "hook 3"], 1]);
  });

  it("has the hook that was read when that is set again", () => {
    const material = new MeshStandardMaterial();
    new SurfacePatch(material, FINISH);
    const before = material.onBeforeCompile;
    chain(material, "hook 1");
    material.onBeforeCompile = before;
    expect([hooksOf(compiled(material).text), compiled(material).finished]).toEqual([[], 1]);
  });

  it("finishes a copy once, with the hooks of the original", () => {
    const material = new MeshStandardMaterial();
    const patch = new SurfacePatch(material, FINISH);
    const copy = material.clone();
    new SurfacePatch(copy, { ...FINISH, key: () => "other" }, patch);
    chain(material, "hook 1");
    expect([hooksOf(compiled(copy).text), compiled(copy).finished]).toEqual([["hook 1"], 1]);
    expect(copy.customProgramCacheKey()).toMatch(/\+hook 1\|lightwell:other$/);
  });
});

it("a finish of nodes has a key that its owner's may call", () => {
  const material = new MeshStandardMaterial();
  const patch = new NodePatch(material, { key: () => "finish", properties: (own) => own });
  chain(material, "hook 1");
  expect(material.customProgramCacheKey()).toMatch(/\+hook 1\|lightwell:finish$/);
  patch.restore();
  expect(material.customProgramCacheKey()).toMatch(/\+hook 1$/);
});

/** Counts what is taken off again. */
function finisher(): Finisher & { restored: number } {
  const made = {
    looks: new Map([["learned" as const, null]]),
    shadowSide: DoubleSide,
    restored: 0,
    patch: () => ({ restore: () => void made.restored++, renew: () => {} }),
  };
  return made;
}

it("what is disposed of frees the bones and instances of its meshes too", () => {
  const instances = new InstancedMesh(undefined, new MeshStandardMaterial(), 2);
  const skinned = new SkinnedMesh(undefined, new MeshStandardMaterial());
  skinned.bind(new Skeleton([new Bone()]));
  skinned.skeleton.computeBoneTexture();
  let [freed, bones] = [0, 0];
  instances.addEventListener("dispose", () => void freed++);
  skinned.skeleton.boneTexture!.addEventListener("dispose", () => void bones++);
  const materials = new SurfaceMaterials(finisher());
  materials.attach(new Object3D().add(instances, skinned));
  materials.dispose(true);
  expect([freed, bones]).toEqual([1, 1]);
});

describe("a material of several objects", () => {
  it("stays patched until the last of them is given back", () => {
    const material = new MeshStandardMaterial({ shadowSide: FrontSide });
    const [one, other] = [new Mesh(undefined, material), new Mesh(undefined, material)];
    const ours = finisher();
    const [first, second] = [new SurfaceMaterials(ours), new SurfaceMaterials(ours)];
    first.attach(one);
    second.attach(other);
    first.detach();
    expect([ours.restored, material.shadowSide]).toEqual([0, DoubleSide]);
    second.detach();
    expect([ours.restored, material.shadowSide]).toEqual([1, FrontSide]);
  });

  it("of another scene is refused, and nothing stays changed", () => {
    const [free, taken] = [new MeshStandardMaterial(), Object.assign(new MeshStandardMaterial(), { name: "paint" })];
    new SurfaceMaterials(finisher()).attach(new Mesh(undefined, taken));
    const meshes = [new Mesh(undefined, free), new Mesh(undefined, taken)];
    const ours = finisher();
    const refused = new SurfaceMaterials(ours);
    expect(() => refused.attach(new Object3D().add(...meshes))).toThrow("material 'paint' belongs to another scene");
    expect(ours.restored).toBe(1);
    expect(meshes.map(({ receiveShadow, castShadow }) => [receiveShadow, castShadow])).toEqual([[false, false], [false, false]]);
    // Nothing of it is taken.
    const later = new SurfaceMaterials(finisher());
    later.attach(meshes[0]!);
    expect(meshes[0]!.receiveShadow).toBe(true);
  });
});
