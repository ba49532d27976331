/** Reads what moves among the variables of a file: nodes and clips. */

import { direction, fail, integer, list, number, record, text, type Vec3, vec3 } from "./checks.ts";
import { MAX_VARIABLES } from "./most.ts";

interface Ranged {
  readonly name: string;
  /** First and last value, in the unit. */
  readonly range: readonly [number, number];
  readonly initial: number;
}

/** A node that turns or slides, as a file declares it. */
export interface NodeRecord extends Ranged {
  readonly kind: "node";
  /** Index of the node in the file. */
  readonly node: number;
  readonly path: "rotation" | "translation";
  /** Unit vector in the space of the node's parent. */
  readonly axis: Vec3;
  /** What a translation by 0 adds to that of the file, metres. */
  readonly offset: Vec3;
  readonly unit: "degrees" | "metres";
}

/** An animation of the file whose time is a variable. */
export interface ClipRecord extends Ranged {
  readonly kind: "clip";
  /** Index of the animation in the file. */
  readonly animation: number;
  /** The nodes that it moves, indices in the file. */
  readonly nodes: readonly number[];
  /** Shares of the animation, 0 to 1. */
  readonly unit: "share";
}

export type MoverRecord = NodeRecord | ClipRecord;

const MAX_VALUE = 1e6;
const MAX_PARTS = 32;
const MAX_CHANNELS = 2 * MAX_PARTS;

/** The parts of a glTF document that what moves names. */
export interface MovingJson {
  readonly nodes?: unknown;
  readonly animations?: unknown;
}

/** Read what moves among `extension.variables`; lights come first. */
export function readMovers(value: unknown, where: string, json: MovingJson): MoverRecord[] {
  const entries = list(value ?? [], where, MAX_VARIABLES).map((entry, i) => record(entry, `${where}[${i}]`));
  const first = entries.findIndex(({ kind }) => kind === "node" || kind === "clip");
  if (first < 0) return [];
  return entries.slice(first).map((entry, i) => readMover(entry, `${where}[${first + i}]`, json));
}

function readMover(entry: Record<string, unknown>, where: string, json: MovingJson): MoverRecord {
  if (entry.kind === "clip") return readClip(entry, where, json);
  if (entry.kind !== "node") fail(`${where}.kind`, '"node" or "clip": lights come before what moves');
  const { path } = entry;
  if (path !== "rotation" && path !== "translation") fail(`${where}.path`, '"rotation" or "translation"');
  const unit = path === "rotation" ? "degrees" : "metres";
  return {
    kind: "node",
    ...ranged(entry, where, unit, [-MAX_VALUE, MAX_VALUE]),
    node: integer(entry.node, `${where}.node`, 0, count(json.nodes) - 1),
    path,
    axis: direction(entry.axis, `${where}.axis`),
    offset: vec3(entry.offset ?? [0, 0, 0], `${where}.offset`),
    unit,
  };
}

function readClip(entry: Record<string, unknown>, where: string, json: MovingJson): ClipRecord {
  const animation = integer(entry.animation, `${where}.animation`, 0, count(json.animations) - 1);
  const at = `animations[${animation}]`;
  const channels = list(record((json.animations as unknown[])[animation], at).channels, `${at}.channels`, MAX_CHANNELS);
  const targets = channels.map((channel, i) => record(record(channel, `${at}.channels[${i}]`).target, `${at}.channels[${i}].target`));
  const nodes = targets.map(({ node }, i) => integer(node, `${at}.channels[${i}].target.node`, 0, count(json.nodes) - 1));
  return { kind: "clip", ...ranged(entry, where, "share", [0, 1]), animation, nodes: [...new Set(nodes)], unit: "share" };
}

function ranged(entry: Record<string, unknown>, where: string, unit: string, limits: readonly [number, number]): Ranged {
  if (entry.unit !== unit) fail(`${where}.unit`, `"${unit}"`);
  const ends = list(entry.range, `${where}.range`, 2).map((x, i) => number(x, `${where}.range[${i}]`, ...limits));
  const [low, high] = ends;
  if (low === undefined || high === undefined || low === high) fail(`${where}.range`, "two different numbers");
  return {
    name: text(entry.name, `${where}.name`),
    range: [low!, high!],
    initial: number(entry.initial, `${where}.initial`, Math.min(low!, high!), Math.max(low!, high!)),
  };
}

function count(entries: unknown): number {
  return Array.isArray(entries) ? entries.length : 0;
}
