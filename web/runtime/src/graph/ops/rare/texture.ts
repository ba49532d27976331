/** The op texture: a table over the unit square, interpolated. */

import type { Op } from "../../op.ts";
import { interpolatedOp } from "../interpolated-table.ts";

export const texture: Op = interpolatedOp(2);
