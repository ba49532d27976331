/** The ops that most fields have: every export of the files in `common/`, under its own name. */

/// <reference types="vite/types/importMeta.d.ts" />

import type { Op } from "../op.ts";
import { merged } from "./merged.ts";

export const COMMON_OPS = /* @__PURE__ */ merged(import.meta.glob<Record<string, Op>>("./common/*.ts", { eager: true }));
