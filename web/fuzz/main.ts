/** Fuzzes the readers of the web runtime in worker processes of limited memory and time, and counts how it ends. */

import { type ChildProcess, fork } from "node:child_process";
import { parseArgs } from "node:util";
import { writeFileSync } from "node:fs";
import type { Format } from "./files.ts";
import { MUTATORS, type Kind } from "./mutators.ts";
import type { Shaders } from "./target.ts";
import type { Job, Report } from "./worker.ts";

/** Longest time for one file, and most memory of a worker. */
const HANG_SECONDS = "10";
const MEBIBYTES = 2048;
const HEAP_MEBIBYTES = 1024;
const MAX_FAILURES = 50;

/** What `benchmarks/fuzz.py` reads. */
interface Counts {
  mutants: number;
  accepted: number;
  refused: number;
  crashes: number;
  hangs: number;
  too_much_memory: number;
  silent_nan: number;
  uncaught: number;
}

interface Failure {
  readonly format: Format;
  readonly kind: Kind;
  readonly number: number;
  readonly what: string;
  readonly file: string;
}

class Campaign {
  readonly counts: Counts = { mutants: 0, accepted: 0, refused: 0, crashes: 0, hangs: 0, too_much_memory: 0, silent_nan: 0, uncaught: 0 };
  readonly failures: Failure[] = [];
  /** Refusals by kind of damage: a mutator that nothing refuses damages nothing. */
  readonly refused = new Map<string, number>();
  readonly shaders = new Map<string, Shaders>();
  readonly seed: number;
  readonly until: number;
  private readonly worker: string;
  private readonly hangSeconds: number;

  constructor(worker: string, seed: number, until: number, hangSeconds: number) {
    [this.worker, this.seed, this.until, this.hangSeconds] = [worker, seed, until, hangSeconds];
  }

  /** Run mutants of a format, `first` to `last` − 1 of each kind, in as many processes as it takes. */
  async run(format: Format, kinds: readonly Kind[], first: number, last: number): Promise<void> {
    const [start, end] = [first * kinds.length, last * kinds.length];
    for (let next = start; next < end && Date.now() < this.until; ) next = await this.batch({ format, kinds, seed: this.seed, first: next, last: end });
  }

  /** Three mutants, of which one hangs, one ends its process and one throws what it must not. */
  async testItself(): Promise<void> {
    const job: Job = { format: "lwp", kinds: ["bits"], seed: this.seed, first: 0, last: 3, fault: true };
    for (let first = 0; first < job.last; ) first = await this.batch({ ...job, first });
  }

  /** One process; returns the number of the mutant that comes next. */
  private batch(job: Job): Promise<number> {
    const child = fork(this.worker, { execArgv: [`--max-old-space-size=${HEAP_MEBIBYTES}`], stdio: ["ignore", "ignore", "ignore", "ipc"] });
    let next = job.first;
    let timer: NodeJS.Timeout | undefined;
    return new Promise((resolve) => {
      const stop = (fault: keyof Counts | null, what = "") => {
        if (!timer) return;
        clearTimeout(timer);
        timer = undefined;
        if (fault) this.fail(job, next++, fault, what, "");
        end(child);
        resolve(next);
      };
      const watch = () => {
        clearTimeout(timer);
        timer = setTimeout(() => stop("hangs", `no end within ${this.hangSeconds} s`), 1000 * this.hangSeconds);
      };
      watch();
      child.on("exit", (code, signal) => stop("crashes", `worker ended: ${signal ?? code}`));
      child.on("message", (report: Report) => {
        watch();
        if ("begin" in report) return;
        this.take(job, report);
        next = report.end + 1;
        if (report.mebibytes > MEBIBYTES) {
          next--;
          stop("too_much_memory", `${report.mebibytes} MiB`);
        } else if (next >= job.last || Date.now() > this.until) stop(null);
      });
      child.send(job);
    });
  }

  private take(job: Job, { end: number, outcome, file }: Extract<Report, { end: number }>): void {
    const { kind, message = "", shaders = [] } = outcome;
    if (kind === "uncaught" || kind === "silent_nan") return this.fail(job, number, kind, message, file);
    this.counts.mutants++;
    this.counts[kind]++;
    const damage = job.kinds[number % job.kinds.length]!;
    if (kind === "refused") this.refused.set(damage, (this.refused.get(damage) ?? 0) + 1);
    for (const one of shaders) this.shaders.set(JSON.stringify(one), one);
  }

  private fail({ format, kinds }: Job, number: number, fault: keyof Counts, what: string, file: string): void {
    const kind = kinds[number % kinds.length]!;
    this.counts.mutants++;
    this.counts[fault]++;
    if (this.failures.length < MAX_FAILURES) this.failures.push({ format, kind, number, what: `${fault}: ${what}`, file });
  }
}

function end(child: ChildProcess): void {
  child.removeAllListeners();
  child.kill("SIGKILL");
}

/** Run from the command line; the answer is one JSON object on standard output. */
export async function main(worker: string, argv: readonly string[]): Promise<void> {
  const { values } = parseArgs({
    args: [...argv],
    options: {
      mutants: { type: "string", default: "20" },
      seed: { type: "string", default: "1" },
      seconds: { type: "string", default: "1e9" },
      formats: { type: "string", default: "glb,lwp,lwsp" },
      kinds: { type: "string", default: Object.keys(MUTATORS).join() },
      first: { type: "string", default: "0" },
      shaders: { type: "string" },
      "hang-seconds": { type: "string", default: HANG_SECONDS },
      "self-test": { type: "boolean", default: false },
    },
  });
  const campaign = new Campaign(worker, Number(values.seed), Date.now() + 1000 * Number(values.seconds), Number(values["hang-seconds"]));
  const first = Number(values.first);
  const kinds = values.kinds.split(",") as Kind[];
  const formats = values["self-test"] ? [] : (values.formats.split(",") as Format[]);
  if (values["self-test"]) await campaign.testItself();
  for (const format of formats) await campaign.run(format, kinds, first, first + Number(values.mutants));
  const { counts, failures, refused, seed, shaders } = campaign;
  if (values.shaders) writeFileSync(values.shaders, JSON.stringify([...shaders.values()]));
  process.stdout.write(`${JSON.stringify({ ...counts, seed, refused_by_kind: Object.fromEntries(refused), failures })}\n`);
}
