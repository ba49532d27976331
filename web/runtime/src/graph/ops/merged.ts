/** Exports of several files as one record. */

import type { Op } from "../op.ts";

/** The ops of files that were imported, by name. */
export const merged = (files: Readonly<Record<string, Readonly<Record<string, Op>>>>): Readonly<Record<string, Op>> =>
  Object.fromEntries(Object.values(files).flatMap((file) => Object.entries(file)));
