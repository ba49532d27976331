/** What moves in a file: doors, lids, blinds, clips. The learned light follows the value of each. */

import { type AnimationClip, AnimationMixer, type Material, Matrix4, Mesh, type Object3D, Quaternion, Vector3 } from "three";
import type { Lightmap } from "./lightmap.ts";
import { copyOf } from "./material-copy.ts";
import type { MoverRecord, NodeRecord } from "./mover-record.ts";
import { TO_REST } from "./to-rest.ts";

/** A node that moves with all that hangs on it, and how it gets back to rest. */
class Part {
  readonly object: Object3D;
  private readonly rest = new Matrix4();
  /** Those of its materials: every scene that is made of one file moves the same ones. */
  private readonly toRest = new Set<Matrix4>();

  /** Materials that other parts or what stands still have too are copied for this part. */
  constructor(object: Object3D, root: Object3D, taken: ReadonlySet<Object3D>, lightmaps: Map<Material, Lightmap>) {
    this.object = object;
    this.rest.copy(root.matrixWorld).invert().multiply(object.matrixWorld);
    const own = new Map<Material, Material>();
    const moving = meshesBelow(object, taken);
    const others = new Set<Material>();
    root.traverse((mesh) => {
      if (mesh instanceof Mesh && !moving.has(mesh)) for (const material of [mesh.material].flat() as Material[]) others.add(material);
    });
    const ownOf = (material: Material): Material => {
      if (!own.has(material)) own.set(material, others.has(material) ? copyOf(material, lightmaps) : material);
      const found = own.get(material)!;
      const toRest = TO_REST.get(found) ?? new Matrix4();
      TO_REST.set(found, toRest);
      this.toRest.add(toRest);
      return found;
    };
    for (const mesh of moving) mesh.material = Array.isArray(mesh.material) ? mesh.material.map(ownOf) : ownOf(mesh.material);
  }

  /** Take over where the node is now; its world matrix and that of the root are up to date. */
  update(toRoot: Matrix4): void {
    // In the space of the root: rest · now⁻¹.
    const now = toRoot.clone().multiply(this.object.matrixWorld);
    now.invert().premultiply(this.rest);
    for (const toRest of this.toRest) toRest.copy(now);
  }
}

/** The meshes below a node, but for those of other parts. */
function meshesBelow(object: Object3D, taken: ReadonlySet<Object3D>): Set<Mesh> {
  const found = new Set<Mesh>();
  const visit = (node: Object3D) => {
    if (node instanceof Mesh) found.add(node);
    for (const child of node.children) if (!taken.has(child)) visit(child);
  };
  visit(object);
  return found;
}

/** Turns or slides a node. */
class NodeDrive {
  private readonly record: NodeRecord;
  private readonly object: Object3D;
  private readonly place: Vector3;
  private readonly turn: Quaternion;

  constructor(record: NodeRecord, object: Object3D) {
    this.record = record;
    this.object = object;
    this.place = object.position.clone();
    this.turn = object.quaternion.clone();
  }

  apply(value: number): void {
    const { object, record } = this;
    const axis = new Vector3(...record.axis);
    object.matrixAutoUpdate = true;
    if (record.path === "rotation") object.quaternion.setFromAxisAngle(axis, (value * Math.PI) / 180).multiply(this.turn);
    else object.position.copy(this.place).add(new Vector3(...record.offset)).addScaledVector(axis, value);
  }

  restore(): void {
    this.object.position.copy(this.place);
    this.object.quaternion.copy(this.turn);
  }
}

/** Shows an animation of the file at one time. */
class ClipDrive {
  private readonly clip: AnimationClip;
  private readonly objects: readonly Object3D[];
  private readonly mixer: AnimationMixer;

  constructor(clip: AnimationClip, root: Object3D, objects: readonly Object3D[]) {
    this.clip = clip;
    this.objects = objects;
    this.mixer = new AnimationMixer(root);
  }

  apply(value: number): void {
    for (const object of this.objects) object.matrixAutoUpdate = true;
    const action = this.mixer.clipAction(this.clip).play();
    action.time = value * this.clip.duration;
    this.mixer.update(0);
  }

  restore(): void {
    this.mixer.stopAllAction();
  }
}

/** A node or a clip that moves: set `value`, in degrees, metres or shares of the clip. */
export class Mover {
  readonly record: MoverRecord;
  /** The node, or the first one of a clip. */
  readonly object: Object3D;
  private at: number;
  private readonly parts: readonly Part[];
  private readonly drive: NodeDrive | ClipDrive;
  private moved = true;

  /** `objects`: the nodes, at rest below `root`; `clip`: of a record of one; `lightmaps`: of the file's materials, and of copies from now on. */
  constructor(record: MoverRecord, objects: readonly Object3D[], root: Object3D, clip: AnimationClip | null = null, lightmaps = new Map<Material, Lightmap>()) {
    this.record = record;
    this.object = objects[0]!;
    this.at = record.initial;
    root.updateWorldMatrix(true, true);
    const taken = new Set(objects);
    this.parts = objects.map((object) => new Part(object, root, taken, lightmaps));
    this.drive = record.kind === "clip" ? new ClipDrive(clip!, root, objects) : new NodeDrive(record, this.object);
  }

  get name(): string {
    return this.record.name;
  }

  /** Degrees, metres or a share of the clip. */
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

  /** Put the nodes where the value says; returns whether they have moved since the last call. */
  follow(root: Object3D): boolean {
    if (!this.moved) return false;
    this.moved = false;
    this.drive.apply(this.at);
    root.updateWorldMatrix(true, false);
    const toRoot = root.matrixWorld.clone().invert();
    for (const { object } of this.parts) object.updateWorldMatrix(true, true);
    for (const part of this.parts) part.update(toRoot);
    return true;
  }

  /** Put the nodes back where the file has them. */
  restore(): void {
    this.drive.restore();
    for (const { object } of this.parts) object.updateWorldMatrix(true, true);
    this.moved = true;
  }
}
