// The WGSL that the browser runs for a shading graph: node tools/print-wgsl.mjs < JOB.json > PROGRAM.json
//
// JOB      { "graph": as in FORMAT.md, "arrays": { buffer: numbers as stored }, "weights": "storage" | "inline",
//            "frame": { "light": [x, y, z] } }
// PROGRAM  { "code", "type", "parameters": [{ name, width }], "weights": { "binding", "data" } | null,
//            "frame": { "binding", "data" } | null }
//          with data as base64 of little-endian 32-bit floats. The function is `field`; its bindings are in group 1.
//
// Needs the web's packages (npm ci in web/): Vite loads the runtime's own TypeScript.
import { createRequire } from "node:module";
import { fileURLToPath, pathToFileURL } from "node:url";

const web = new URL("../web/", import.meta.url);
const { runnerImport } = await import(pathToFileURL(createRequire(new URL("package.json", web)).resolve("vite")).href);
const entry = fileURLToPath(new URL("runtime/src/graph/index.ts", web));
const { module: runtime } = await runnerImport(entry, { configFile: false, logLevel: "error", root: fileURLToPath(web) });

const STORAGE = { float32: Float32Array, float16: Uint16Array, int8: Int8Array, uint8: Uint8Array };
let text = "";
for await (const chunk of process.stdin.setEncoding("utf8")) text += chunk;
const job = JSON.parse(text);
const buffers = new Map(
  Object.entries(job.graph.buffers).map(([name, declared]) => {
    const numbers = job.arrays[name];
    const stored = declared.type === "float16" ? numbers.map(runtime.toHalf) : numbers;
    return [name, { ...declared, data: STORAGE[declared.type].from(stored) }];
  }),
);
const graph = runtime.readGraph(job.graph, buffers);
const program = runtime.printWgsl(graph, { name: "field", weights: job.weights, group: 1 });
const base64 = (numbers) => Buffer.from(numbers.buffer, numbers.byteOffset, numbers.byteLength).toString("base64");
process.stdout.write(
  JSON.stringify({
    code: program.code,
    type: program.type,
    parameters: program.parameters,
    weights: program.weights && { binding: program.weights.binding, data: base64(program.weights.data) },
    frame: program.frame && { binding: program.frame.binding, data: base64(runtime.evaluateFrame(graph, job.frame)) },
  }),
);
