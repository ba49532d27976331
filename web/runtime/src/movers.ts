/** Nodes of a file that move: doors, lids, blinds. The learned light follows the value of each. */

import { Material, Matrix4, Mesh, type Object3D, Quaternion, Vector3 } from "three";
import { direction, fail, integer, list, number, record, text, type Vec3, vec3 } from "./checks.ts";
import { MAX_VARIABLES } from "./variables.ts";

/** A node that moves, as a file declares it. */
export interface MoverRecord {
  readonly name: string;
  /** Index of the node in the file. */
  readonly node: number;
  readonly path: "rotation" | "translation";
  /** Unit vector in the space of the node's parent. */
  readonly axis: Vec3;
  /** What a translation by 0 adds to that of the file, metres. */
  readonly offset: Vec3;
  /** First and last value, in the unit. */
  readonly range: readonly [number, number];
  readonly unit: "degrees" | "metres";
  readonly initial: number;
}

const MAX_VALUE = 1e6;

/** Read the nodes among `extension.variables`; `nodes`: how many the file has. Lights come first. */
export function readMovers(value: unknown, where: string, nodes: number): MoverRecord[] {
  const entries = list(value ?? [], where, MAX_VARIABLES).map((entry, i) => record(entry, `${where}[${i}]`));
  const first = entries.findIndex(({ kind }) => kind === "node");
  if (first < 0) return [];
  return entries.slice(first).map((entry, i) => readMover(entry, `${where}[${first + i}]`, nodes));
}

function readMover(entry: Record<string, unknown>, where: string, nodes: number): MoverRecord {
  if (entry.kind !== "node") fail(`${where}.kind`, '"node": lights come before nodes');
  const { path } = entry;
  if (path !== "rotation" && path !== "translation") fail(`${where}.path`, '"rotation" or "translation"');
  const unit = path === "rotation" ? "degrees" : "metres";
  if (entry.unit !== unit) fail(`${where}.unit`, `"${unit}"`);
  const ends = list(entry.range, `${where}.range`, 2).map((x, i) => number(x, `${where}.range[${i}]`, -MAX_VALUE, MAX_VALUE));
  const [low, high] = ends;
  if (low === undefined || high === undefined || low === high) fail(`${where}.range`, "two different numbers");
  return {
    name: text(entry.name, `${where}.name`),
    node: integer(entry.node, `${where}.node`, 0, nodes - 1),
    path,
    axis: direction(entry.axis, `${where}.axis`),
    offset: vec3(entry.offset ?? [0, 0, 0], `${where}.offset`),
    range: [low!, high!],
    unit,
    initial: number(entry.initial, `${where}.initial`, Math.min(low!, high!), Math.max(low!, high!)),
  };
}

/** Where surfaces of a material were before they moved, in the space of the root; for materials of what moves. */
const TO_REST = new WeakMap<Material, Matrix4>();
const STILL = new Matrix4();

/** From the place of a material's surfaces to where they rest, in the space of the root. */
export function toRestOf(material: Material): Matrix4 {
  return TO_REST.get(material) ?? STILL;
}

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

/** Values by name from a text such as `Door:45;Slide:0.6`; what is malformed is left out. */
export function readMoverValues(given: string | null): ReadonlyMap<string, number> {
  const found = new Map<string, number>();
  for (const part of (given ?? "").split(";").slice(0, MAX_VARIABLES)) {
    const at = part.lastIndexOf(":");
    const value = part.slice(at + 1).trim() === "" ? Number.NaN : Number(part.slice(at + 1));
    if (at > 0 && Number.isFinite(value)) found.set(decoded(part.slice(0, at).trim()), value);
  }
  return found;
}

/** The same text for movers that are not where the file shows them first; empty when all are. */
export function moverValuesText(movers: readonly Mover[]): string {
  return movers
    .filter(({ value, record: { initial } }) => value !== initial)
    .map(({ name, value }) => `${encodeURIComponent(name)}:${Number(value.toPrecision(5))}`)
    .join(";");
}

function decoded(name: string): string {
  try {
    return decodeURIComponent(name);
  } catch {
    return name;
  }
}
