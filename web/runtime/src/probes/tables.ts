/** From the compact sections of a file to the tables that shaders read: four words a node, twelve a cell. */

/** Sections as they are stored. */
export interface Stored {
  /** A byte a probe: its kind (0 dropped, 1 trusted everywhere, 2 weighted), 4 for inner fine probes. */
  readonly kinds: Uint8Array;
  /** Two words a weighted probe. */
  readonly octants: Uint32Array;
  /** Eight words a live probe. */
  readonly light: Uint32Array;
  /** A byte a cell: whether it has a row of fallbacks. */
  readonly cells: Uint8Array;
  /** Eight bytes a row. */
  readonly fallbacks: Uint8Array;
  /** 65 words a brick: its cell, its probes. */
  readonly bricks: Uint32Array;
}

/** What shaders read of it. */
export interface Tables {
  readonly nodes: Uint32Array;
  readonly light: Uint32Array;
  readonly cells: Uint32Array;
  readonly bricks: Uint32Array;
}

type Check = (good: boolean, expected: string) => asserts good;

/** Nodes along an edge of the block that a byte of a fallback names, how many lie below the cell, and no node at all. */
const [SIDE, BELOW, NONE] = [6, 2, 255];
const BRICK = 65;

/** Expands and checks the tables of a lattice of nodes along x, y, z. */
export function expanded(stored: Stored, shape: readonly [number, number, number], check: Check): Tables {
  const { kinds, octants } = stored;
  const count = shape[0] * shape[1] * shape[2];
  const tables = stored.bricks.length / BRICK;
  check(kinds.length >= count && kinds.length > count === tables > 0, "a kind of each probe");
  const nodes = new Uint32Array(4 * kinds.length);
  const light = new Uint32Array(8 * kinds.length);
  let [record, live] = [0, 0];
  for (let i = 0; i < kinds.length; i++) {
    const kind = kinds[i]! & 3;
    check(kind < 3, "kinds of probes");
    nodes.fill(0xffffffff, 4 * i + 1, 4 * i + 3);
    nodes[4 * i] = kind;
    nodes[4 * i + 3] = (kinds[i]! >> 2) & 1;
    if (kind) light.set(stored.light.subarray(8 * live, 8 * ++live), 8 * i);
    if (kind < 2) continue;
    nodes[4 * i] = 2 + record;
    nodes.set(octants.subarray(2 * record, 2 * ++record), 4 * i + 1);
  }
  check(2 * record === octants.length && 8 * live === stored.light.length, "a record and light of each live probe");
  return { nodes, light, ...expandedCells(stored, shape, kinds.length, check) };
}

function expandedCells(stored: Stored, shape: readonly [number, number, number], probes: number, check: Check): Pick<Tables, "cells" | "bricks"> {
  const [nx, ny, nz] = shape;
  const [cx, cy] = [nx - 1, ny - 1];
  const total = cx * cy * (nz - 1);
  check(stored.cells.length === total, `${total} cells`);
  const cells = new Uint32Array(12 * total);
  let row = 0;
  for (let c = 0; c < total; c++) {
    if (!stored.cells[c]) continue;
    check(8 * row + 8 <= stored.fallbacks.length, "fallbacks of each cell");
    for (let k = 0; k < 8; k++) {
      const code = stored.fallbacks[8 * row + k]!;
      if (code === NONE) continue;
      const x = (c % cx) + (code % SIDE) - BELOW;
      const y = (Math.floor(c / cx) % cy) + (Math.floor(code / SIDE) % SIDE) - BELOW;
      const z = Math.floor(c / (cx * cy)) + Math.floor(code / SIDE ** 2) - BELOW;
      check(x >= 0 && y >= 0 && z >= 0 && x < nx && y < ny && z < nz, "nodes that exist");
      cells[12 * c + k] = 1 + (z * ny + y) * nx + x;
    }
    row++;
  }
  check(8 * row === stored.fallbacks.length, "fallbacks of each cell");
  const count = stored.bricks.length / BRICK;
  const bricks = new Uint32Array(64 * count);
  for (let b = 0; b < count; b++) {
    const cell = stored.bricks[BRICK * b]!;
    check(cell < total && (b === 0 || cell > stored.bricks[BRICK * (b - 1)]!), "cells of bricks, in order");
    cells[12 * cell + 8] = 1 + b;
    bricks.set(stored.bricks.subarray(BRICK * b + 1, BRICK * (b + 1)), 64 * b);
  }
  for (const probe of bricks) check(probe >= nx * ny * nz && probe < probes, "fine probes that exist");
  return { cells, bricks };
}
