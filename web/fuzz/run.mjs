/**
 * Fuzzes the readers of the web runtime: node web/fuzz/run.mjs [--mutants N] [--seed S] [--seconds T] [--formats glb,lwp,lwsp]
 * [--kinds bits,…] [--first N] [--shaders FILE] [--hang-seconds T]. Mutants are per kind of damage and format. Prints one JSON object:
 * { mutants, accepted, refused, crashes, hangs, too_much_memory, silent_nan, uncaught, seed, refused_by_kind, failures }.
 * The exit code is 0 when it ran, whatever it found.
 */

import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";
import { build } from "vite";

const here = (path) => fileURLToPath(new URL(path, import.meta.url));
const folder = mkdtempSync(join(tmpdir(), "lightwell-fuzz-"));
process.env.LIGHTWELL_ROOT ??= here("../../");
try {
  await build({
    configFile: false,
    root: here("."),
    logLevel: "error",
    ssr: { noExternal: true },
    build: {
      ssr: true,
      outDir: folder,
      emptyOutDir: true,
      target: "node20",
      rollupOptions: { input: { main: here("main.ts"), worker: here("worker.ts") }, output: { format: "es", entryFileNames: "[name].mjs" } },
    },
  });
  const { main } = await import(pathToFileURL(join(folder, "main.mjs")).href);
  await main(join(folder, "worker.mjs"), process.argv.slice(2));
} finally {
  rmSync(folder, { recursive: true });
}
