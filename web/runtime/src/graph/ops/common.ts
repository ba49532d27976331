/** The ops that most fields have. */

import type { Op } from "../op.ts";
import { activate } from "./activate.ts";
import { add, affine, blend, clamp, log, multiply, reciprocal, scale, select, subtract } from "./arithmetic.ts";
import { dot, length, normalize, reflect } from "./geometry.ts";
import { hashgrid } from "./hashgrid.ts";
import { linear, matvec } from "./linear.ts";
import { concat, slice } from "./shape.ts";

export const COMMON_OPS: Readonly<Record<string, Op>> = {
  activate,
  add,
  affine,
  blend,
  clamp,
  concat,
  dot,
  hashgrid,
  length,
  linear,
  log,
  matvec,
  multiply,
  normalize,
  reciprocal,
  reflect,
  scale,
  select,
  slice,
  subtract,
};
