/** Reads a shading graph from untrusted JSON: a `Graph` that exists is valid (see `format/FORMAT.md`). */

import { fail, integer, list, number, record, text } from "../checks.ts";
import { BUDGET, type Budget, checkLive, WorkCounter } from "./budget.ts";
import { fromHalf } from "./half.ts";
import {
  MAX_ELEMENTS,
  MAX_MACS,
  MAX_NODES,
  MAX_NUMBER,
  MAX_WIDTH,
  type Op,
  type Parameter,
  type StoredBuffer,
  type Use,
} from "./op.ts";
import type { Graph, GraphNode } from "./node.ts";
import { costs } from "./part.ts";

/** Inputs that are the same for every pixel of a frame. */
export const FRAME_INPUTS: readonly string[] = ["light", "lamps", "pose"];
/** Inputs that `per_frame` nodes alone may use: shaders have no such value. */
export const FRAME_ONLY: readonly string[] = ["lamps", "pose"];
const MAX_INPUTS = 64;
const NAME = /^[A-Za-z_][A-Za-z0-9_.]{0,63}$/;
const NODE_KEYS = ["id", "op", "inputs", "per_frame"];

function name(value: unknown, where: string): string {
  const found = text(value, where);
  if (!NAME.test(found)) fail(where, "a name of letters, digits, _ and . (at most 64)");
  return found;
}

function entries(value: unknown, where: string, low: number, high: number): [string, unknown][] {
  const found = Object.entries(record(value, where));
  if (found.length < low || found.length > high)
    fail(where, `${low} to ${high} entries, found ${found.length}`);
  for (const [key] of found) name(key, where);
  return found;
}

/**
 * Check a graph and its buffers (stored numbers by name), and that it stays within a budget; throws a `FormatError` that
 * names what is wrong. `ops` are those that it may name.
 */
export function readGraphOf(
  ops: Readonly<Record<string, Op>>,
  json: unknown,
  stored: ReadonlyMap<string, StoredBuffer>,
  budget: Budget = BUDGET,
): Graph {
  const document = record(json, "graph");
  const known = ["version", "inputs", "buffers", "nodes", "outputs"];
  for (const key of Object.keys(document))
    if (!known.includes(key)) fail(`graph.${key.slice(0, 40)}`, "nothing of that name");
  if (document.version !== 1) fail("graph.version", "1");
  const inputs = new Map(
    entries(document.inputs, "graph.inputs", 1, MAX_INPUTS).map(([key, w]) => [
      key,
      integer(w, `graph.inputs.${key}`, 1, MAX_WIDTH),
    ]),
  );
  const buffers = new Map<string, StoredBuffer>();
  for (const [key, declared] of entries(document.buffers, "graph.buffers", 0, MAX_NODES)) {
    const where = `graph.buffers.${key}`;
    record(declared, where);
    const buffer = stored.get(key) ?? fail(where, "its numbers beside the graph");
    checkBuffer(buffer, where);
    buffers.set(key, buffer);
  }
  const widths = new Map(inputs);
  const frame = new Set(FRAME_INPUTS.filter((key) => inputs.has(key)));
  const used = new Set<string>();
  const counter = new WorkCounter(budget);
  const nodes = list(document.nodes, "graph.nodes", MAX_NODES).map((value, i) => {
    const node = readNode(ops, value, `graph.nodes[${i}]`, widths, buffers, frame, used);
    counter.add(node, `graph.nodes[${i}] ('${node.id}')`);
    widths.set(node.id, node.width);
    if (node.perFrame) frame.add(node.id);
    return node;
  });
  if (nodes.length === 0) fail("graph.nodes", "at least one node");
  const outputs = new Map<string, string>();
  for (const [key, value] of entries(document.outputs, "graph.outputs", 1, MAX_INPUTS)) {
    if (typeof value !== "string" || !widths.has(value))
      fail(`graph.outputs.${key}`, "the name of an input or node");
    outputs.set(key, value);
  }
  for (const key of buffers.keys())
    if (!used.has(key)) fail(`graph.buffers.${key}`, "a buffer that some node uses");
  checkLive(nodes, inputs, outputs.values(), budget, "graph.nodes");
  const graph = { inputs, nodes, outputs, widths, ...costs(nodes) };
  if (Math.max(graph.macs, graph.macsPerFrame) > MAX_MACS)
    fail("graph.nodes", `at most ${MAX_MACS} multiply-adds`);
  return graph;
}

function checkBuffer(buffer: StoredBuffer, where: string): void {
  const size = buffer.shape.reduce(
    (product, side, i) => product * integer(side, `${where}.shape[${i}]`, 1, MAX_ELEMENTS),
    1,
  );
  if (buffer.shape.length < 1 || buffer.shape.length > 4 || size > MAX_ELEMENTS) {
    fail(`${where}.shape`, `1 to 4 sizes, at most ${MAX_ELEMENTS} elements`);
  }
  const found = buffer.data.length;
  if (buffer.picture ? found !== 0 && found !== size : found !== size) fail(where, `${size} numbers, found ${found}`);
  if (buffer.picture && (buffer.type !== "uint8" || buffer.shape.length !== 3 || buffer.shape[2] !== 3)) {
    fail(where, "uint8 [H, W, 3]");
  }
  if (buffer.type === "float32" || buffer.type === "float16") {
    if (buffer.scale !== undefined || buffer.offset) fail(where, "no scale or offset on a float type");
    const finite =
      buffer.type === "float32" ? Number.isFinite : (bits: number) => Number.isFinite(fromHalf(bits));
    for (const x of buffer.data) if (!finite(x)) fail(where, "finite numbers");
    return;
  }
  if (buffer.type !== "int8" && buffer.type !== "uint8")
    fail(`${where}.type`, "float32, float16, int8 or uint8");
  const scales = typeof buffer.scale === "number" ? [buffer.scale] : [...(buffer.scale ?? [])];
  const [rows, columns = 1] = buffer.shape as [number, number?];
  if (![1, rows, rows * columns].includes(scales.length)) {
    fail(`${where}.scale`, "one number, or one per index of the first axis or of the first two");
  }
  const offset = number(buffer.offset ?? 0, `${where}.offset`, -MAX_NUMBER, MAX_NUMBER);
  for (const scale of scales)
    number(Math.abs(scale) * 255 + Math.abs(offset), `${where}.scale`, 0, MAX_NUMBER);
}

function readNode(
  ops: Readonly<Record<string, Op>>,
  value: unknown,
  where: string,
  widths: ReadonlyMap<string, number>,
  buffers: ReadonlyMap<string, StoredBuffer>,
  frame: ReadonlySet<string>,
  used: Set<string>,
): GraphNode {
  const json = record(value, where);
  const id = name(json.id, `${where}.id`);
  if (widths.has(id)) fail(`${where}.id`, "a new name");
  const opName = text(json.op, `${where}.op`);
  const op =
    (Object.hasOwn(ops, opName) ? ops[opName] : undefined) ??
    fail(`${where}.op`, `one of ${Object.keys(ops).sort().join(", ")}`);
  const perFrame = json.per_frame ?? false;
  if (typeof perFrame !== "boolean") fail(`${where}.per_frame`, "true or false");
  const inputs = list(json.inputs, `${where}.inputs`, 256).map((input) => {
    if (typeof input !== "string" || !widths.has(input))
      fail(`${where}.inputs`, "graph inputs or earlier nodes");
    if (!perFrame && FRAME_ONLY.includes(input)) fail(`${where}.per_frame`, `true, because '${input}' is an input`);
    if (perFrame && !frame.has(input))
      fail(`${where}.inputs`, "frame inputs only, because the node is per_frame");
    return input;
  });
  if (inputs.length < op.arity[0] || inputs.length > op.arity[1]) {
    fail(`${where}.inputs`, `${op.arity[0]} to ${op.arity[1]} inputs of ${opName}`);
  }
  const use = readUse(
    json,
    id,
    where,
    op,
    inputs.map((input) => widths.get(input)!),
    buffers,
    used,
  );
  const width = op.width(use);
  use.expect(width >= 1 && width <= MAX_WIDTH, `a value of width 1 to ${MAX_WIDTH}`);
  return { id, op, opName, inputs, perFrame, use, width };
}

function readUse(
  json: Record<string, unknown>,
  id: string,
  where: string,
  op: Op,
  widths: readonly number[],
  buffers: ReadonlyMap<string, StoredBuffer>,
  used: Set<string>,
): Use {
  const parameters = op.parameters ?? {};
  for (const key of Object.keys(json)) {
    if (!NODE_KEYS.includes(key) && !Object.hasOwn(parameters, key))
      fail(`${where}.${key.slice(0, 40)}`, "nothing of that name");
  }
  const found = {
    number: {} as Record<string, number>,
    numbers: {} as Record<string, readonly number[]>,
    choice: {} as Record<string, string>,
    buffer: {} as Record<string, StoredBuffer>,
  };
  for (const [key, parameter] of Object.entries(parameters)) {
    readParameter(key, parameter, json[key], `${where}.${key}`, widths[0]!, buffers, used, found);
  }
  const expect = (condition: boolean, expected: string) => {
    if (!condition) fail(`${where} ('${id}')`, expected);
  };
  return { id, widths, expect, ...found };
}

function readParameter(
  key: string,
  parameter: Parameter,
  value: unknown,
  where: string,
  width: number,
  buffers: ReadonlyMap<string, StoredBuffer>,
  used: Set<string>,
  found: { [K in "number" | "numbers" | "choice" | "buffer"]: Record<string, Use[K][string]> },
): void {
  if (parameter.kind === "number") found.number[key] = number(value, where, parameter.low, parameter.high);
  else if (parameter.kind === "integer")
    found.number[key] = integer(value, where, parameter.low, parameter.high);
  else if (parameter.kind === "numbers") {
    const numbers = list(value, where, MAX_WIDTH);
    if (numbers.length !== width) fail(where, `${width} numbers`);
    found.numbers[key] = numbers.map((x) => number(x, where, -MAX_NUMBER, MAX_NUMBER));
  } else if (parameter.kind === "choice") {
    if (typeof value !== "string" || !parameter.choices.includes(value))
      fail(where, `one of ${parameter.choices.join(", ")}`);
    found.choice[key] = value;
  } else {
    const buffer =
      (typeof value === "string" ? buffers.get(value) : undefined) ?? fail(where, "the name of a buffer");
    if (!parameter.ranks.includes(buffer.shape.length))
      fail(where, `a buffer of ${parameter.ranks.join(" or ")} axes`);
    if (buffer.picture && !parameter.picture) fail(where, "no picture");
    used.add(value as string);
    found.buffer[key] = buffer;
  }
}
