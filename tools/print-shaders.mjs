// Every test vector of format/vectors as a function `field` in a shading language: node tools/print-shaders.mjs LANGUAGE > PROGRAMS.json
//
// LANGUAGE  hlsl, msl, gdshader or wgsl
// PROGRAMS  [{ "name", "weights": "inline" | "table", "code", "signature", "parameters": [{ name, width }], "outputs": [{ name, width }],
//              "textures": [{ "name", "width", "height", "format", "data": base64 }] }]
//
// Everything is evaluated per pixel, as in the texts of `lightwell export`. Needs the web's packages (npm ci in web/).
import { readdirSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { fileURLToPath, pathToFileURL } from "node:url";

const language = process.argv[2];
const web = new URL("../web/", import.meta.url);
const { runnerImport } = await import(pathToFileURL(createRequire(new URL("package.json", web)).resolve("vite")).href);
const load = async (path) => {
  const options = { configFile: false, logLevel: "error", root: fileURLToPath(web) };
  return (await runnerImport(fileURLToPath(new URL(path, web)), options)).module;
};
const { printWgsl, readGraph, toHalf } = await load("runtime/src/graph/index.ts");
const { DIALECTS } = await load("runtime/src/graph/dialects.ts");
const { printDialect } = await load("runtime/src/graph/print-dialect.ts");

const STORAGE = { float32: Float32Array, float16: Uint16Array, int8: Int8Array, uint8: Uint8Array };
const base64 = (numbers) => Buffer.from(numbers.buffer, numbers.byteOffset, numbers.byteLength).toString("base64");

function graphOf({ graph, arrays }) {
  const buffers = Object.entries(graph.buffers).map(([name, declared]) => {
    const stored = declared.type === "float16" ? arrays[name].map(toHalf) : arrays[name];
    return [name, { ...declared, data: STORAGE[declared.type].from(stored) }];
  });
  const read = readGraph(graph, new Map(buffers));
  return { ...read, nodes: read.nodes.map((node) => ({ ...node, perFrame: false })) };
}

function print(graph, weights) {
  if (language === "wgsl") return { ...printWgsl(graph, { name: "field", weights: weights === "inline" ? "inline" : "storage" }), textures: [] };
  return printDialect(graph, DIALECTS[language], { name: "field", weights: weights === "inline" ? "inline" : "texture" });
}

const folder = new URL("../format/vectors/", import.meta.url);
const programs = [];
for (const file of readdirSync(folder).sort()) {
  const vector = JSON.parse(readFileSync(new URL(file, folder), "utf8"));
  const graph = graphOf(vector);
  for (const weights of ["inline", "table"]) {
    const { code, signature, parameters, textures } = print(graph, weights);
    const outputs = [...graph.outputs].map(([name, id]) => ({ name, width: graph.widths.get(id) }));
    programs.push({
      name: vector.name,
      weights,
      code,
      signature,
      parameters,
      outputs,
      textures: textures.map((texture) => ({ ...texture, data: base64(texture.data) })),
    });
  }
}
process.stdout.write(JSON.stringify(programs));
