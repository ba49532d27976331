/** Reads the nodes among the variables of a file. */

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
