/** The materials of a scene's meshes, one set for each thing that surfaces can show; made when first worn. */

import { DoubleSide, Line, type Material, Mesh, MeshStandardMaterial, type Object3D, Points } from "three";
import type { Lightmap } from "./loader.ts";
import type { SurfaceFinish } from "./surface-finish.ts";
import { finishMaterial } from "./surface-shader.ts";

/**
 * `plain`: direct light alone. `learned`: with learned light. `indirect`: demodulated learned light alone, for a small
 * picture. `upsampled`: with the learned light of that picture. `segments`: the segmentation. `lightmap`: with ordinary light maps.
 */
export type Outfit = "plain" | "learned" | "indirect" | "upsampled" | "segments" | "lightmap";

/** Owns the materials; the meshes and their textures are those of the loaded file. */
export class Wardrobe {
  private readonly meshes: readonly { readonly mesh: Mesh; readonly plain: Mesh["material"] }[];
  /** Materials of lines and points, which have no finish: a small picture leaves them out. */
  private readonly others: readonly Material[];
  private readonly finishes: Readonly<Partial<Record<Outfit, SurfaceFinish>>>;
  private readonly lightmaps: ReadonlyMap<Material, Lightmap>;
  private readonly twins = new Map<Outfit, Map<Material, Material>>();
  private worn: Outfit = "plain";

  /** An outfit without a finish is the plain one. */
  constructor(
    root: Object3D,
    finishes: Readonly<Partial<Record<Outfit, SurfaceFinish>>>,
    lightmaps: ReadonlyMap<Material, Lightmap> = new Map(),
  ) {
    this.finishes = finishes;
    this.lightmaps = lightmaps;
    const meshes: { mesh: Mesh; plain: Mesh["material"] }[] = [];
    const others: Material[] = [];
    root.traverse((object) => {
      if (object instanceof Mesh) meshes.push({ mesh: object, plain: object.material });
      else if (object instanceof Line || object instanceof Points) others.push(...[object.material].flat());
    });
    this.meshes = meshes;
    this.others = others.filter((material) => material.visible);
    for (const { mesh, plain } of meshes) {
      mesh.receiveShadow = true;
      mesh.castShadow = [plain].flat().some(blocksLight);
    }
    for (const material of new Set(meshes.flatMap(({ plain }) => plain))) {
      // A path tracer sees both sides of a sheet as blockers; so must the shadow map.
      material.shadowSide = DoubleSide;
      if (finishes.plain && material instanceof MeshStandardMaterial) finishMaterial(material, finishes.plain);
    }
  }

  /** Put an outfit on every mesh. */
  wear(outfit: Outfit): void {
    if (outfit === this.worn) return;
    this.worn = outfit;
    for (const material of this.others) material.visible = outfit !== "indirect";
    for (const { mesh, plain } of this.meshes) {
      mesh.material = Array.isArray(plain)
        ? plain.map((material) => this.twinOf(material, outfit))
        : this.twinOf(plain, outfit);
    }
  }

  /** Make ordinary light maps shine by this factor. */
  brighten(factor: number): void {
    for (const [material, { intensity }] of this.lightmaps) {
      const twin = this.twins.get("lightmap")?.get(material);
      if (twin) (twin as MeshStandardMaterial).lightMapIntensity = factor * intensity;
    }
  }

  /** The finishes have changed: compile everything anew when it is worn next. */
  renew(): void {
    for (const material of this.materials()) material.needsUpdate = true;
  }

  dispose(): void {
    for (const { mesh } of this.meshes) mesh.geometry.dispose();
    for (const material of this.materials()) disposeMaterial(material);
    for (const { map } of this.lightmaps.values()) map.dispose();
  }

  private *materials(): Generator<Material> {
    for (const { plain } of this.meshes) yield* [plain].flat();
    for (const twins of this.twins.values()) yield* twins.values();
  }

  private twinOf(material: Material, outfit: Outfit): Material {
    const finish = this.finishes[outfit];
    if (outfit === "plain" || !finish) return material;
    // A small picture has one depth a pixel: what is blended is drawn at full resolution alone.
    if (outfit === "upsampled" && material.transparent) return this.twinOf(material, "learned");
    const twins = this.twins.get(outfit) ?? new Map<Material, Material>();
    this.twins.set(outfit, twins);
    let twin = twins.get(material);
    if (!twin) {
      const hidden = outfit === "indirect" && (material.transparent || !(material instanceof MeshStandardMaterial));
      if (!hidden && !(material instanceof MeshStandardMaterial)) return material;
      twin = material.clone();
      twin.visible = !hidden;
      const lightmap = outfit === "lightmap" ? this.lightmaps.get(material) : undefined;
      if (lightmap) {
        (twin as MeshStandardMaterial).lightMap = lightmap.map;
        (twin as MeshStandardMaterial).lightMapIntensity = lightmap.intensity;
      }
      finishMaterial(twin as MeshStandardMaterial, finish);
      twins.set(material, twin);
    }
    return twin;
  }
}

/** Blended and transmissive surfaces would cast solid shadows. */
function blocksLight(material: Material): boolean {
  const transmission = (material as { transmission?: number }).transmission ?? 0;
  return !material.transparent && transmission < 0.5;
}

function disposeMaterial(material: Material): void {
  for (const value of Object.values(material)) {
    if (value && typeof value === "object" && (value as { isTexture?: boolean }).isTexture) {
      (value as { dispose(): void }).dispose();
    }
  }
  material.dispose();
}
