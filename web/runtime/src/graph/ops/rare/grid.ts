/** The op grid: a table over the unit cube, interpolated. */

import type { Op } from "../../op.ts";
import { interpolatedOp } from "../interpolated-table.ts";

export const grid: Op = interpolatedOp(3);
