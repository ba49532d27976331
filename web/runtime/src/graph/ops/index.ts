/** The ops of the shading graph by name: every export of the files in `common/` and `rare/`. A new op is a file there. */

/// <reference types="vite/types/importMeta.d.ts" />

import type { Op } from "../op.ts";
import { merged } from "./merged.ts";

// A bundler leaves it out where nothing asks for all of them.
export const OPS = /* @__PURE__ */ merged(import.meta.glob<Record<string, Op>>(["./common/*.ts", "./rare/*.ts"], { eager: true }));
