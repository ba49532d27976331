/** The ops that a file needs: those of most fields are at hand, the others are loaded when a graph names one. */

/// <reference types="vite/types/importMeta.d.ts" />

import type { Op } from "../op.ts";
import { COMMON_OPS } from "./common.ts";

type Ops = Readonly<Record<string, Op>>;

/** The ops that few fields have: one in a file of its name. */
const RARE = import.meta.glob<Ops>("./rare/*.ts");
const path = (name: string): string => `./rare/${name}.ts`;

/** The ops of these names; all there are when one of the names is none of them, for the message that says so. */
export async function opsFor(names: Iterable<string>): Promise<Ops> {
  const rare = [...new Set(names)].filter((name) => !Object.hasOwn(COMMON_OPS, name)).map(path);
  const wanted = rare.every((file) => Object.hasOwn(RARE, file)) ? rare : Object.keys(RARE);
  return Object.assign({ ...COMMON_OPS }, ...(await Promise.all(wanted.map((file) => RARE[file]!()))));
}
