/** The ops that a file needs: those of most fields are at hand, the others are loaded when a graph names one. */

import type { Op } from "../op.ts";
import { COMMON_OPS } from "./common.ts";

type Ops = Readonly<Record<string, Op>>;

const encoding = async (): Promise<Ops> => {
  const { frequency, oneblob, sh } = await import("./encoding.ts");
  return { frequency, oneblob, sh };
};
const fetch = async (): Promise<Ops> => {
  const { grid, texture } = await import("./fetch.ts");
  return { grid, texture };
};
const lookup = async (): Promise<Ops> => {
  const { nearest, rows } = await import("./lookup.ts");
  return { nearest, rows };
};

/** Where the ops are that few fields have. */
const RARE: Readonly<Record<string, () => Promise<Ops>>> = {
  frequency: encoding,
  grid: fetch,
  nearest: lookup,
  oneblob: encoding,
  rows: lookup,
  sh: encoding,
  texture: fetch,
  top2: async (): Promise<Ops> => ({ top2: (await import("./top2.ts")).top2 }),
  tree: async (): Promise<Ops> => ({ tree: (await import("./tree.ts")).tree }),
};

/** The ops of these names; all there are when one of the names is none of them, for the message that says so. */
export async function opsFor(names: Iterable<string>): Promise<Ops> {
  const rare = [...new Set(names)].filter((name) => !Object.hasOwn(COMMON_OPS, name));
  const wanted = rare.every((name) => Object.hasOwn(RARE, name)) ? rare : Object.keys(RARE);
  const loaded = await Promise.all(wanted.map(async (name) => [name, (await RARE[name]!())[name]!] as const));
  return { ...COMMON_OPS, ...Object.fromEntries(loaded) };
}
