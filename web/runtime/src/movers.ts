/** Nodes of a file that move: doors, lids, blinds. The learned light follows the value of each. */

import { type Material, Matrix4, Mesh, type Object3D, Quaternion, Vector3 } from "three";
import type { MoverRecord } from "./mover-record.ts";
import { TO_REST } from "./to-rest.ts";

/** A node that moves: set `value`, in degrees or metres. */
export class Mover {
  readonly record: MoverRecord;
  readonly object: Object3D;
  private at: number;
  private readonly place: Vector3;
  private readonly turn: Quaternion;
  private readonly rest = new Matrix4();
  private readonly toRest = new Matrix4();
  private moved = true;

  /** `object`: the node, at rest below `root`. Materials that what stands still has too are copied for what moves. */
  constructor(record: MoverRecord, object: Object3D, root: Object3D) {
    this.record = record;
    this.object = object;
    this.at = record.initial;
    this.place = object.position.clone();
    this.turn = object.quaternion.clone();
    root.updateWorldMatrix(true, true);
    this.rest.copy(root.matrixWorld).invert().multiply(object.matrixWorld);
    const still = new Set<Material>();
    const moving = new Set<Mesh>();
    object.traverse((part) => void (part instanceof Mesh && moving.add(part)));
    root.traverse((part) => {
      if (part instanceof Mesh && !moving.has(part)) for (const material of [part.material].flat() as Material[]) still.add(material);
    });
    const own = new Map<Material, Material>();
    const ownOf = (material: Material): Material => {
      if (!own.has(material)) own.set(material, still.has(material) ? material.clone() : material);
      const found = own.get(material)!;
      TO_REST.set(found, this.toRest);
      return found;
    };
    for (const mesh of moving) mesh.material = Array.isArray(mesh.material) ? mesh.material.map(ownOf) : ownOf(mesh.material);
  }

  get name(): string {
    return this.record.name;
  }

  /** Degrees or metres. */
  get value(): number {
    return this.at;
  }

  /** Numbers outside of the range are brought into it. */
  set value(value: number) {
    const [first, last] = this.record.range;
    const next = Math.min(Math.max(value, Math.min(first, last)), Math.max(first, last));
    if (next === this.at || !Number.isFinite(next)) return;
    this.at = next;
    this.moved = true;
  }

  /** The input of fields: 0 at the first value, 1 at the last. */
  get pose(): number {
    const [first, last] = this.record.range;
    return (this.at - first) / (last - first);
  }

  /** Put the node where its value says; returns whether it has moved since the last call. */
  follow(root: Object3D): boolean {
    if (!this.moved) return false;
    this.moved = false;
    const { object, record } = this;
    const axis = new Vector3(...record.axis);
    object.matrixAutoUpdate = true;
    if (record.path === "rotation") {
      object.quaternion.setFromAxisAngle(axis, (this.at * Math.PI) / 180).multiply(this.turn);
    } else object.position.copy(this.place).add(new Vector3(...record.offset)).addScaledVector(axis, this.at);
    object.updateWorldMatrix(true, true);
    root.updateWorldMatrix(true, false);
    // In the space of the root: rest · now⁻¹.
    const now = root.matrixWorld.clone().invert().multiply(object.matrixWorld);
    this.toRest.multiplyMatrices(this.rest, now.invert());
    return true;
  }

  /** Put the node back where the file has it. */
  restore(): void {
    this.object.position.copy(this.place);
    this.object.quaternion.copy(this.turn);
    this.object.updateWorldMatrix(true, true);
    this.moved = true;
  }
}
