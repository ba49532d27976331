/** From the compact sections of a file to the tables that shaders read: four words a node, twelve a cell, four a sheet. */

/** Sections as they are stored. */
export interface Stored {
  /** A byte a probe: its kind (0 dropped, 1 trusted everywhere, 2 weighted), 4 for inner fine probes. */
  readonly kinds: Uint8Array;
  /** Two words a weighted probe. */
  readonly octants: Uint32Array;
  /** Eight words a live probe. */
  readonly light: Uint32Array;
  /** A byte a cell: 1 where it has a row of fallbacks, 2 where it has a sheet. */
  readonly cells: Uint8Array;
  /** Eight bytes a row. */
  readonly fallbacks: Uint8Array;
  /** 66 words a brick: its cell, its probes, which of its fine cells have a sheet. */
  readonly bricks: Uint32Array;
  /** Five half words a sheet: its plane, the corners that count. */
  readonly sheets: Uint16Array;
}

/** What shaders read of it. */
export interface Tables {
  readonly nodes: Uint32Array;
  readonly light: Uint32Array;
  /** Fallbacks of eight octants, the brick, the sheet; counted from 1. */
  readonly cells: Uint32Array;
  /** 64 probes, then the sheets of 27 fine cells, counted from 1. */
  readonly bricks: Uint32Array;
  /** Two words of half floats, the corners that count, nothing. */
  readonly sheets: Uint32Array;
}

type Check = (good: boolean, expected: string) => asserts good;

/** Nodes along an edge of the block that a byte of a fallback names, how many lie below the cell, and no node at all. */
const [SIDE, BELOW, NONE] = [6, 2, 255];
const BRICK = 66;
/** Words of a brick that shaders read, and bits of a cell. */
export const BRICK_WORDS = 92;
const [DOUBT, CUT, FINE_CELLS] = [1, 2, 27];

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

function expandedCells(stored: Stored, shape: readonly [number, number, number], probes: number, check: Check): Pick<Tables, "cells" | "bricks" | "sheets"> {
  const [nx, ny, nz] = shape;
  const [cx, cy] = [nx - 1, ny - 1];
  const total = cx * cy * (nz - 1);
  check(stored.cells.length === total, `${total} cells`);
  const cells = new Uint32Array(12 * total);
  let [row, sheet] = [0, 0];
  for (let c = 0; c < total; c++) {
    const kind = stored.cells[c]!;
    check(kind <= (DOUBT | CUT), "kinds of cells");
    if (kind & CUT) cells[12 * c + 9] = ++sheet;
    if (!(kind & DOUBT)) continue;
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
  const bricks = new Uint32Array(BRICK_WORDS * count);
  for (let b = 0; b < count; b++) {
    const cell = stored.bricks[BRICK * b]!;
    check(cell < total && (b === 0 || cell > stored.bricks[BRICK * (b - 1)]!), "cells of bricks, in order");
    cells[12 * cell + 8] = 1 + b;
    const fine = stored.bricks.subarray(BRICK * b + 1, BRICK * b + 65);
    for (const probe of fine) check(probe >= nx * ny * nz && probe < probes, "fine probes that exist");
    bricks.set(fine, BRICK_WORDS * b);
    const cut = stored.bricks[BRICK * b + 65]!;
    for (let k = 0; k < FINE_CELLS; k++) if ((cut >> k) & 1) bricks[BRICK_WORDS * b + 64 + k] = ++sheet;
  }
  check(5 * sheet === stored.sheets.length, "a sheet of each cell that has one");
  return { cells, bricks, sheets: expandedSheets(stored.sheets, check) };
}

function expandedSheets(stored: Uint16Array, check: Check): Uint32Array {
  const out = new Uint32Array((4 * stored.length) / 5);
  for (let i = 0; i < out.length / 4; i++) {
    const [x, y, z, d, corners] = stored.subarray(5 * i, 5 * i + 5);
    for (const half of [x!, y!, z!, d!]) check(((half >> 10) & 31) < 31, "finite planes");
    out.set([x! | (y! << 16), z! | (d! << 16), corners!], 4 * i);
  }
  return out;
}
