/**
 * The materials of a scene's meshes. Those of the file are patched in place and show the learned light; every other thing that
 * surfaces can show has copies of its own, which follow the originals and are made when they are first needed.
 */

import { InstancedMesh, Line, type Material, Mesh, type MeshStandardMaterial, type Object3D, Points, type Side, SkinnedMesh } from "three";
import { isClear } from "./clear-glass.ts";
import type { Lightmap } from "./loaded-light.ts";

/**
 * `plain`: direct light alone. `learned`: with learned light. `indirect`: demodulated learned light alone, for a small
 * picture. `upsampled`: with the learned light of that picture. `segments`: the segmentation. `lightmap`: with ordinary light maps.
 */
export type SurfaceLook = "plain" | "learned" | "indirect" | "upsampled" | "segments" | "lightmap";

/** What an adapter has put on a material. */
export interface Patch {
  /** Take it off; what the material's owner has set stays. */
  restore(): void;
  /** The number of lamps has changed: compile anew. */
  renew(): void;
}

/** How an adapter shows the looks that have shaders of their own; a look that is not among them is that of the plain one. */
export interface Finisher {
  readonly looks: { has(look: SurfaceLook): boolean };
  /** Which sides shadow maps see; null leaves it to the material. */
  readonly shadowSide: Side | null;
  /** Put a look on a material; `original` is the patch of the material that this one is a copy of. */
  patch(material: MeshStandardMaterial, look: SurfaceLook, original?: Patch): Patch;
}

interface Entry {
  readonly mesh: Mesh;
  /** What the mesh has of its own: the file's material, or what its owner gave it since. */
  own: Mesh["material"];
  /** What was put on it last. */
  given: Mesh["material"];
  readonly castShadow: boolean;
  readonly receiveShadow: boolean;
}

interface Twin {
  readonly material: Material;
  readonly patch: Patch | null;
  /** Version of the original that the copy is of. */
  version: number;
}

/** What was put on a material, for all who show meshes of it. */
interface Held {
  readonly finisher: Finisher;
  /** Null for a material without a finish. */
  readonly patch: Patch | null;
  /** Which sides its shadows had. */
  readonly shadowSide: Material["shadowSide"];
  users: number;
}

/** Materials that are taken over, whoever did it: a material with a finish has one finisher, but may be of several objects that it lights. */
const HELD = new WeakMap<Material, Held>();

/** Owns the patches and the copies; meshes, materials and textures are those of the loaded file. */
export class SurfaceMaterials {
  private entries: Entry[] = [];
  /** Materials of lines and points, which have no finish: a small picture leaves them out. */
  private others: Material[] = [];
  /** What was taken over last: `dispose` frees it after `detach` too. */
  private drawn: (Mesh | Line | Points)[] = [];
  private readonly finisher: Finisher;
  private readonly glass: boolean | undefined;
  private readonly lightmaps: ReadonlyMap<Material, Lightmap>;
  private readonly held = new Map<Material, Held>();
  private readonly twins = new Map<SurfaceLook, Map<Material, Twin>>();
  private shown: SurfaceLook = "learned";
  private brightness = 1;

  /** `glass`: clear glass has the learned look too. */
  constructor(finisher: Finisher, lightmaps: ReadonlyMap<Material, Lightmap> = new Map(), glass?: boolean) {
    this.finisher = finisher;
    this.glass = glass;
    this.lightmaps = lightmaps;
  }

  /** Take the meshes under a root over; all of them, or none where it throws. */
  attach(root: Object3D): void {
    this.drawn = [];
    root.traverse((object) => {
      if (object instanceof Mesh) {
        const { material, castShadow, receiveShadow } = object;
        this.entries.push({ mesh: object, own: material, given: material, castShadow, receiveShadow });
        object.receiveShadow = true;
        object.castShadow = [material].flat().some(blocksLight);
      } else if (object instanceof Line || object instanceof Points) this.others.push(...[object.material].flat());
      else return;
      this.drawn.push(object);
    });
    this.others = this.others.filter((material) => material.visible);
    this.shown = "learned";
    try {
      for (const { own } of this.entries) for (const material of [own].flat()) this.patch(material);
    } catch (error) {
      this.detach();
      throw error;
    }
  }

  /** Give everything back as it was, but for what its owner has changed since. */
  detach(): void {
    for (const material of this.others) material.visible = true;
    for (const { mesh, own, given, castShadow, receiveShadow } of this.entries)
      Object.assign(mesh, { castShadow, receiveShadow, material: mesh.material === given ? own : mesh.material });
    for (const [material, held] of this.held) {
      if (--held.users > 0) continue;
      held.patch?.restore();
      if (held.finisher.shadowSide !== null) material.shadowSide = held.shadowSide;
      HELD.delete(material);
    }
    for (const { material } of this.allTwins()) material.dispose();
    this.held.clear();
    this.twins.clear();
    this.entries = [];
    this.others = [];
  }

  /** Show something on every mesh. */
  show(look: SurfaceLook): void {
    const again = look === this.shown;
    this.shown = look;
    for (const material of this.others) material.visible = look !== "indirect";
    for (const entry of this.entries) {
      if (entry.mesh.material !== entry.given) this.adopt(entry);
      else if (again && look === "learned") continue;
      const { own } = entry;
      entry.given = Array.isArray(own) ? own.map((material) => this.copyFor(material, look)) : this.copyFor(own, look);
      entry.mesh.material = entry.given;
    }
  }

  /** Make ordinary light maps shine by this factor. */
  brighten(factor: number): void {
    this.brightness = factor;
  }

  /** The finishes have changed: compile everything anew when it is shown next. */
  renew(): void {
    for (const { patch } of this.held.values()) patch?.renew();
    for (const { patch } of this.allTwins()) patch?.renew();
  }

  /** Give everything back, and free what GPUs hold of it; textures too if they are asked for. What is used again is uploaded again. */
  dispose(textures: boolean): void {
    this.detach();
    const materials = new Set(this.drawn.flatMap(({ material }) => material));
    for (const geometry of new Set(this.drawn.map(({ geometry }) => geometry))) geometry.dispose();
    for (const mesh of this.drawn) {
      if (mesh instanceof SkinnedMesh) mesh.skeleton?.dispose();
      // Renderers free the buffers of instances; its own `dispose` would throw their morph targets away.
      if (mesh instanceof InstancedMesh) mesh.dispatchEvent({ type: "dispose" });
    }
    for (const material of materials) {
      if (textures) for (const texture of texturesOf(material)) texture.dispose();
      material.dispose();
    }
    if (textures) for (const { map } of this.lightmaps.values()) map.dispose();
  }

  private *allTwins(): Generator<Twin> {
    for (const twins of this.twins.values()) yield* twins.values();
  }

  /** Someone has given a mesh another material: it is the mesh's own from now on. */
  private adopt(entry: Entry): void {
    entry.own = entry.mesh.material;
    for (const material of [entry.own].flat()) this.patch(material);
  }

  private patch(material: Material): void {
    if (this.held.has(material)) return;
    const held = HELD.get(material) ?? this.hold(material);
    if (held.patch && held.finisher !== this.finisher)
      throw new Error(`LearnedScene: material '${material.name}' belongs to another scene; clone it, or dispose of that scene first`);
    held.users++;
    this.held.set(material, held);
  }

  private hold(material: Material): Held {
    const { finisher } = this;
    const look = finisher.looks.has("learned") && (this.glass || !isClearGlass(material)) ? "learned" : "plain";
    const held = { finisher, shadowSide: material.shadowSide, patch: isStandard(material) ? finisher.patch(material, look) : null, users: 0 };
    if (finisher.shadowSide !== null) material.shadowSide = finisher.shadowSide;
    HELD.set(material, held);
    return held;
  }

  /** The material that shows a look in the place of an original, up to date with it. */
  private copyFor(material: Material, look: SurfaceLook): Material {
    const { looks } = this.finisher;
    if (look === "learned" || !looks.has(look) || (look === "plain" && !looks.has("learned"))) return material;
    // A small picture has one depth a pixel: what is blended or shows what lies behind is drawn at full resolution alone.
    const seeThrough = material.transparent || isClearGlass(material);
    if (look === "upsampled" && seeThrough) return material;
    const hidden = look === "indirect" && (seeThrough || !isStandard(material));
    if (!hidden && !isStandard(material)) return material;
    const twins = this.twins.get(look) ?? new Map<Material, Twin>();
    this.twins.set(look, twins);
    const twin = twins.get(material) ?? this.makeTwin(material, look);
    twins.set(material, twin);
    this.follow(twin, material, look, hidden);
    return twin.material;
  }

  private makeTwin(material: Material, look: SurfaceLook): Twin {
    const copy = material.clone();
    const patch = isStandard(copy) ? this.finisher.patch(copy, look, this.held.get(material)?.patch ?? undefined) : null;
    return { material: copy, patch, version: material.version };
  }

  /** Carry edits of the original over to its copy. */
  private follow(twin: Twin, original: Material, look: SurfaceLook, hidden: boolean): void {
    const copy = twin.material;
    copy.copy(original);
    copy.visible = original.visible && !hidden;
    const lightmap = look === "lightmap" ? this.lightmaps.get(original) : undefined;
    if (lightmap) {
      (copy as MeshStandardMaterial).lightMap = lightmap.map;
      (copy as MeshStandardMaterial).lightMapIntensity = this.brightness * lightmap.intensity;
    }
    if (twin.version === original.version) return;
    twin.version = original.version;
    copy.needsUpdate = true;
  }
}

/** Whether a material has the surface model of the file's: standard and physical ones, and those of nodes that stand for them. */
function isStandard(material: Material): material is MeshStandardMaterial {
  return (material as Partial<MeshStandardMaterial>).isMeshStandardMaterial === true;
}

/** Blended surfaces and clear glass would cast solid shadows. What frosted glass lets through is learned light. */
function blocksLight(material: Material): boolean {
  return !material.transparent && !isClearGlass(material);
}

function isClearGlass(material: Material): boolean {
  return isStandard(material) && isClear((material as { transmission?: number }).transmission ?? 0, material.roughness);
}

function texturesOf(material: Material): { dispose(): void }[] {
  return Object.values(material).filter((value) => (value as { isTexture?: boolean } | null)?.isTexture);
}
