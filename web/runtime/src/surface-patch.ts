/** Puts a finish on a three.js material in place, together with the owner's own `onBeforeCompile`, and takes it off again. */

import type { Material, MeshStandardMaterial, WebGLProgramParametersWithUniforms, WebGLRenderer } from "three";
import type { SurfaceFinish } from "./surface-finish.ts";
import type { Patch } from "./surface-materials.ts";
import { patchSurfaceShader } from "./surface-shader.ts";
import { toRestOf } from "./to-rest.ts";

type Hook = Material["onBeforeCompile"];
type CacheKey = Material["customProgramCacheKey"];

/**
 * While it is there, `material.onBeforeCompile` may be read and set as ever: the function that its owner gives is called
 * first, on the shader as three.js wrote it.
 */
export class SurfacePatch implements Patch {
  private readonly material: MeshStandardMaterial;
  /** What the owner has set, before or since; undefined for what the class has. */
  private hook: Hook | undefined;
  private cacheKey: CacheKey | undefined;

  /** `original`: whose owner's functions count, for a copy of a material. */
  constructor(material: MeshStandardMaterial, finish: SurfaceFinish, original?: SurfacePatch) {
    this.material = material;
    this.hook = ownValue(material, "onBeforeCompile");
    this.cacheKey = ownValue(material, "customProgramCacheKey");
    const owner = original ?? this;
    const compile = (shader: WebGLProgramParametersWithUniforms, renderer: WebGLRenderer) => {
      (owner.hook ?? Object.getPrototypeOf(material).onBeforeCompile).call(owner.material, shader, renderer);
      patchSurfaceShader(shader, renderer, finish, toRestOf(owner.material));
    };
    const key = () => `${owner.ownKey()}|lightwell:${finish.key()}`;
    Object.defineProperties(material, {
      onBeforeCompile: { configurable: true, enumerable: true, get: () => compile, set: (hook: Hook) => void (this.hook = hook) },
      customProgramCacheKey: { configurable: true, enumerable: true, get: () => key, set: (given: CacheKey) => void (this.cacheKey = given) },
    });
    material.needsUpdate = true;
  }

  /** Take the finish off; what the owner has set stays. */
  restore(): void {
    const { material, hook, cacheKey } = this;
    for (const [name, value] of [["onBeforeCompile", hook], ["customProgramCacheKey", cacheKey]] as const) {
      delete (material as unknown as Record<string, unknown>)[name];
      if (value) Object.assign(material, { [name]: value });
    }
    material.needsUpdate = true;
  }

  renew(): void {
    this.material.needsUpdate = true;
  }

  /** The name that the owner's part of the program has. */
  private ownKey(): string {
    return this.cacheKey ? this.cacheKey.call(this.material) : (this.hook?.toString() ?? "");
  }
}

function ownValue<K extends "onBeforeCompile" | "customProgramCacheKey">(material: Material, name: K): Material[K] | undefined {
  return Object.hasOwn(material, name) ? material[name] : undefined;
}
