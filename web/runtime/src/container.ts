/** Checks of a glTF document that a loader would otherwise answer with a hang or a crash. */

import { fail, integer, list, record } from "./checks.ts";

/** The parts of a glTF document that this package reads; everything in it is untrusted. */
export type GltfJson = Record<string, unknown>;

const MAX_ENTRIES = 1 << 20;
/** 2^28 elements of 16 components are more than a browser can hold. */
const MAX_ACCESSOR_COUNT = 1 << 28;

/** Throws a `FormatError` when accessors or nodes of the document cannot be loaded safely. */
export function checkContainer(json: GltfJson): void {
  checkAccessors(json);
  checkTree(json);
}

/** Every accessor stays inside its buffer view, and no count is absurd. */
function checkAccessors(json: GltfJson): void {
  const views = list(json.bufferViews ?? [], "bufferViews", MAX_ENTRIES);
  list(json.accessors ?? [], "accessors", MAX_ENTRIES).forEach((entry, i) => {
    const accessor = record(entry, `accessors[${i}]`);
    integer(accessor.count, `accessors[${i}].count`, 1, MAX_ACCESSOR_COUNT);
    if (accessor.bufferView !== undefined) {
      integer(accessor.bufferView, `accessors[${i}].bufferView`, 0, views.length - 1);
    } else if (accessor.sparse === undefined) {
      fail(`accessors[${i}]`, "a bufferView");
    }
  });
}

/** The node hierarchy is a forest: a cycle would make a loader wait for itself for ever. */
function checkTree(json: GltfJson): void {
  const nodes = list(json.nodes ?? [], "nodes", MAX_ENTRIES);
  const parent = new Int32Array(nodes.length).fill(-1);
  nodes.forEach((entry, i) => {
    const children = record(entry, `nodes[${i}]`).children ?? [];
    list(children, `nodes[${i}].children`, MAX_ENTRIES).forEach((value, k) => {
      const child = integer(value, `nodes[${i}].children[${k}]`, 0, nodes.length - 1);
      if (parent[child] !== -1)
        fail(`nodes[${i}].children[${k}]`, "a node without another parent");
      parent[child] = i;
    });
  });
  const rooted = new Uint8Array(nodes.length);
  for (let i = 0; i < nodes.length; i++) {
    let at = i;
    for (let steps = 0; at !== -1 && rooted[at] === 0; at = parent[at]!) {
      if (steps++ > nodes.length) fail(`nodes[${i}]`, "a node that is not its own ancestor");
    }
    for (let mark = i; mark !== -1 && rooted[mark] === 0; mark = parent[mark]!) rooted[mark] = 1;
  }
}
