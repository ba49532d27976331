/** The ops of the shading graph by name. A new op is registered here, and then tested in both languages by its vector. */

import type { Op } from "../op.ts";
import { activate } from "./activate.ts";
import {
  add,
  affine,
  blend,
  clamp,
  log,
  multiply,
  reciprocal,
  scale,
  select,
  subtract,
} from "./arithmetic.ts";
import { frequency, oneblob, sh } from "./encoding.ts";
import { grid, texture } from "./fetch.ts";
import { dot, length, normalize, reflect } from "./geometry.ts";
import { hashgrid } from "./hashgrid.ts";
import { linear, matvec } from "./linear.ts";
import { nearest, rows } from "./lookup.ts";
import { concat, slice } from "./shape.ts";
import { top2 } from "./top2.ts";
import { tree } from "./tree.ts";

export const OPS: Readonly<Record<string, Op>> = {
  activate,
  add,
  affine,
  blend,
  clamp,
  concat,
  dot,
  frequency,
  grid,
  hashgrid,
  length,
  linear,
  log,
  matvec,
  multiply,
  nearest,
  normalize,
  oneblob,
  reciprocal,
  reflect,
  rows,
  scale,
  select,
  sh,
  slice,
  subtract,
  texture,
  top2,
  tree,
};
