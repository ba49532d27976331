/** Objects that are not of a file, lit by its probes: loaded when the first one is added. */

import type { Object3D } from "three";
import type { FieldRecord } from "./extension.ts";
import type { LearnedField } from "./learned-field.ts";
import type { SurfaceMaterials } from "./surface-materials.ts";

/** What an adapter makes of the probes of a file. */
export interface LitParts<F extends LearnedField> {
  readonly fields: readonly F[];
  /** Makes what shows their light on the meshes of an object. */
  materials(): SurfaceMaterials;
}

interface Entry {
  readonly materials: SurfaceMaterials;
  /** Where its parts were when they were looked at last. */
  placed: number;
}

/** Owns the materials of the objects while they are lit. */
export class LitObjects<F extends LearnedField> {
  readonly fields: readonly F[];
  private readonly root: Object3D;
  private readonly parts: LitParts<F>;
  private readonly entries = new Map<Object3D, Entry>();

  constructor(root: Object3D, records: readonly FieldRecord[], make: (records: readonly FieldRecord[]) => LitParts<F>) {
    if (records.length === 0) throw new Error("LearnedScene.addLit: expected a file with probes, found none; bake it with --field factored+probes");
    this.root = root;
    this.parts = make(records);
    this.fields = this.parts.fields;
  }

  /** Light an object and all below it. */
  add(object: Object3D): void {
    if (this.entries.has(object)) return;
    for (let above: Object3D | null = object; above; above = above.parent) {
      if (above === this.root) throw new Error("LearnedScene.addLit: expected an object beside root, found one under it; hang it into the scene that root hangs in");
    }
    const materials = this.parts.materials();
    materials.attach(object);
    this.entries.set(object, { materials, placed: Number.NaN });
  }

  /** Give an object back as it was; returns whether it was lit. */
  remove(object: Object3D): boolean {
    this.entries.get(object)?.materials.detach();
    return this.entries.delete(object);
  }

  attach(): void {
    for (const [object, { materials }] of this.entries) materials.attach(object);
  }

  detach(): void {
    for (const { materials } of this.entries.values()) materials.detach();
  }

  /** Light what an owner has given to the meshes since. */
  show(): void {
    for (const { materials } of this.entries.values()) materials.show("learned");
  }

  renew(): void {
    for (const { materials } of this.entries.values()) materials.renew();
  }

  /** Whether a part of an object is elsewhere than before, so that shadows are. */
  moved(): boolean {
    let moved = false;
    for (const [object, entry] of this.entries) {
      const placed = placeOf(object);
      moved ||= placed !== entry.placed;
      entry.placed = placed;
    }
    return moved;
  }
}

/** A number that changes when a part moves, bones among them. */
function placeOf(object: Object3D): number {
  object.updateWorldMatrix(true, true);
  let sum = 0;
  let weight = 1;
  object.traverseVisible(({ matrixWorld }) => {
    for (const element of matrixWorld.elements) sum += element * (weight = (weight * 1.37) % 7.1);
  });
  return sum;
}
