// The lens as the browser runs it, as data: node tools/print-lens.mjs < JOB.json > PLAN.json
//
// JOB      { "still": path of a library or null, "moving": the same, "options": PlanOptions without libraries,
//            "frame": FrameFacts } (web/runtime/src/lens/plan.ts, frame-block.ts)
// PLAN     { "domain", "guard", "buffers": { name: { "bytes", "data": base64 | null } }, "shaders", "steps" }
//
// Needs the web's packages (npm ci in web/): Vite loads the runtime's own TypeScript.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { fileURLToPath, pathToFileURL } from "node:url";

const web = new URL("../web/", import.meta.url);
const { runnerImport } = await import(pathToFileURL(createRequire(new URL("package.json", web)).resolve("vite")).href);
const entry = fileURLToPath(new URL("runtime/src/lens/index.ts", web));
const { module: lens } = await runnerImport(entry, { configFile: false, logLevel: "error", root: fileURLToPath(web) });

let text = "";
for await (const chunk of process.stdin.setEncoding("utf8")) text += chunk;
const job = JSON.parse(text);
const library = async (path) => (path ? lens.readLibrary(new Uint8Array(readFileSync(path))) : null);
const plan = lens.plan({ ...job.options, still: await library(job.still), moving: await library(job.moving) });
const base64 = (view) => Buffer.from(view.buffer, view.byteOffset, view.byteLength).toString("base64");
const data = { frame: new Uint8Array(lens.frameBlock(plan, job.frame)) };
const buffers = Object.fromEntries(
  Object.entries(plan.buffers).map(([name, one]) => {
    const held = one.data ?? data[name];
    return [name, { bytes: one.bytes, data: held ? base64(held) : null }];
  }),
);
process.stdout.write(JSON.stringify({ domain: plan.domain, guard: plan.guard, buffers, shaders: plan.shaders, steps: plan.steps }));
