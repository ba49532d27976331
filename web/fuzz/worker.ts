/** One process that reads damaged files of one format, one after the other; its parent watches time, memory and death. */

import { seeds } from "./seeds.ts";
import { MUTATORS, type Kind } from "./mutators.ts";
import { randomOf } from "./random.ts";
import { examine, type Outcome } from "./target.ts";
import type { Format } from "./files.ts";

/** Pictures are not decoded here: their sizes are those that their heads state. */
function standInForBrowser(): void {
  const scope = globalThis as Record<string, unknown>;
  scope.self = globalThis;
  scope.ProgressEvent = class extends Event {};
  scope.createImageBitmap = async (blob: Blob) => {
    const { pictureSize } = await import("../runtime/src/picture-size.ts");
    const size = pictureSize(new Uint8Array(await blob.arrayBuffer()));
    if (!size) throw new Error("The source image could not be decoded.");
    return { ...size, close() {} };
  };
}

/** What one worker is asked for: mutants `first` to `last` − 1, whose kinds of damage take turns. */
export interface Job {
  readonly format: Format;
  readonly kinds: readonly Kind[];
  readonly seed: number;
  readonly first: number;
  readonly last: number;
  /** Behave as broken readers would: to see that the parent counts it. */
  readonly fault?: boolean;
}

/** What a worker says: that it begins with a mutant, and how that ended. */
export type Report =
  | { readonly begin: number }
  | { readonly end: number; readonly outcome: Outcome; readonly mebibytes: number; readonly file: string };

/** The damaged file of a number: the same for the same seed, whichever process makes it. */
function mutant({ format, kinds, seed }: Job, number: number): { file: Uint8Array<ArrayBuffer>; name: string } {
  const kind = kinds[number % kinds.length]!;
  const index = Math.floor(number / kinds.length);
  const random = randomOf(seed * 7919 + index * 104_729 + Object.keys(MUTATORS).indexOf(kind) * 15_485_863);
  const made = random.of(all.filter((one) => one.format === format));
  return { file: MUTATORS[kind](format, made.bytes, random).slice() as Uint8Array<ArrayBuffer>, name: made.name };
}

const all = seeds();

/** A promise that nobody waited for and that failed: a page would report it as an error of its own. */
let stray = "";
process.on("unhandledRejection", (error) => {
  stray = error instanceof Error ? String(error.stack).slice(0, 600) : String(error);
});

async function faulty(number: number): Promise<Outcome> {
  if (number === 0) for (;;);
  if (number === 1) process.abort();
  return { kind: "uncaught", message: "TypeError" };
}

async function run(job: Job): Promise<void> {
  for (let number = job.first; number < job.last; number++) {
    const { file, name } = mutant(job, number);
    process.send!({ begin: number } satisfies Report);
    stray = "";
    const found = job.fault ? await faulty(number) : await examine(job.format, file);
    await new Promise((resolve) => setImmediate(resolve));
    const outcome: Outcome = stray ? { kind: "uncaught", message: `unhandled: ${stray}` } : found;
    const mebibytes = Math.round(process.resourceUsage().maxRSS / 1024);
    process.send!({ end: number, outcome, mebibytes, file: name } satisfies Report);
  }
}

standInForBrowser();
process.on("message", (job: Job) => void run(job));
