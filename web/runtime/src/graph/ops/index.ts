/** The ops of the shading graph by name. A new op is registered here and in `on-demand.ts` or `common.ts`, and then tested in both languages by its vector. */

import type { Op } from "../op.ts";
import { COMMON_OPS } from "./common.ts";
import { frequency, oneblob, sh } from "./encoding.ts";
import { grid, texture } from "./fetch.ts";
import { nearest, rows } from "./lookup.ts";
import { top2 } from "./top2.ts";
import { tree } from "./tree.ts";

export const OPS: Readonly<Record<string, Op>> = { ...COMMON_OPS, frequency, grid, nearest, oneblob, rows, sh, texture, top2, tree };
