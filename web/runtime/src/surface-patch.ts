/** Puts a finish on a three.js material in place, together with the owner's own `onBeforeCompile`, and takes it off again. */

import type { Material, MeshStandardMaterial } from "three";
import type { SurfaceFinish } from "./surface-finish.ts";
import type { Patch } from "./surface-materials.ts";
import { patchSurfaceShader } from "./surface-shader.ts";
import { toRestOf } from "./to-rest.ts";

/** What the owner of a material may set, and a finish needs. */
type Hooks = Pick<Material, "onBeforeCompile" | "customProgramCacheKey">;
type Own = { [K in keyof Hooks]: Hooks[K] | undefined };
const NAMES = ["onBeforeCompile", "customProgramCacheKey"] as const;

/** The owner's function by what is read in its place, of all materials: setting what was read brings it back. */
const OWN = new WeakMap<Hooks[keyof Hooks], Hooks[keyof Hooks] | undefined>();

/**
 * While it is there, `material.onBeforeCompile` may be read and set as ever: the function that its owner gives is called
 * first, on the shader as three.js wrote it. What is read calls the owner's function of that moment, so that a newer one may call
 * it in turn; the shader is finished once, after the newest.
 */
export class SurfacePatch implements Patch {
  private readonly material: MeshStandardMaterial;
  /** What the owner has set, before or since; undefined for what the class has. */
  private readonly own: Own = { onBeforeCompile: undefined, customProgramCacheKey: undefined };
  /** Whether a function of the owner is running. */
  private inside = false;
  private restored = false;

  /** `original`: whose owner's functions count, for a copy of a material. */
  constructor(material: MeshStandardMaterial, finish: SurfaceFinish, original?: SurfacePatch) {
    this.material = material;
    const owner = original ?? this;
    /** Calls a function of the owner, then ours, unless a newer function of the owner has called this one. */
    const within = <T>(theirs: () => T, ours: (found: T) => T): T => {
      const nested = owner.inside;
      owner.inside = true;
      try {
        const found = theirs();
        return nested || this.restored ? found : ours(found);
      } finally {
        owner.inside = nested;
      }
    };
    this.offer("onBeforeCompile", (hook) => (shader, renderer) =>
      within(
        () => ((original ? original.own.onBeforeCompile : hook) ?? Object.getPrototypeOf(material).onBeforeCompile).call(owner.material, shader, renderer),
        () => patchSurfaceShader(shader, renderer, finish, toRestOf(owner.material)),
      ),
    );
    this.offer("customProgramCacheKey", (key) => () =>
      within(
        () => {
          const named = original ? original.own.customProgramCacheKey : key;
          return named ? named.call(owner.material) : (owner.own.onBeforeCompile?.toString() ?? "");
        },
        (found) => `${found}|lightwell:${finish.key()}`,
      ),
    );
    material.needsUpdate = true;
  }

  /** Take the finish off; what the owner has set stays. */
  restore(): void {
    this.restored = true;
    const { material, own } = this;
    for (const name of NAMES) {
      delete (material as Partial<Hooks>)[name];
      if (own[name]) Object.assign(material, { [name]: own[name] });
    }
    material.needsUpdate = true;
    // A renderer that keeps the finished program would take it again, by its name, with the uniforms of the one that came between.
    material.dispose();
  }

  renew(): void {
    this.material.needsUpdate = true;
  }

  /** Let the material have `wrap` of what its owner has set, and set. */
  private offer<K extends keyof Hooks>(name: K, wrap: (theirs: Hooks[K] | undefined) => Hooks[K]): void {
    const { material, own } = this;
    if (Object.hasOwn(material, name)) own[name] = material[name];
    const wrapped = () => {
      const made = wrap(own[name]);
      OWN.set(made, own[name]);
      return made;
    };
    let shown = wrapped();
    const set = (given: Hooks[K]) => {
      own[name] = OWN.has(given) ? (OWN.get(given) as Hooks[K] | undefined) : given;
      shown = wrapped();
    };
    Object.defineProperty(material, name, { configurable: true, enumerable: true, get: () => shown, set });
  }
}
