// Pictures of an exported light map: node tools/exported-light-maps.mjs JOB.json
//
// JOB      { "frame": as Frame in web/test/pages/exported-light-map.ts without "glb" and "folder", "glb": path of the file,
//            "engines": { "threejs" | "babylon" | "playcanvas": exported folder }, "out": folder for NAME.rgb, last row first }
// The picture "page" is that of lightwell's own runtime. Prints JSON: errors of the pages by engine.
import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";

const web = new URL("../web/", import.meta.url);
const { runnerImport } = await import(pathToFileURL(createRequire(new URL("package.json", web)).resolve("vite")));
const load = async (path) =>
  (await runnerImport(fileURLToPath(new URL(path, web)), { configFile: false, logLevel: "error", root: fileURLToPath(web) })).module;
const { bundle, modulePage } = await load("test/support/bundle.ts");
const { launchAlone, openPage, Site } = await load("test/support/browser.ts");

const job = JSON.parse(readFileSync(process.argv[2], "utf8"));
const glb = readFileSync(job.glb).toString("base64");
const site = new Site();
await site.open();
const browser = await launchAlone("swiftshader");
const problems = {};
const page = (name) => JSON.stringify(fileURLToPath(new URL(`test/pages/exported-light-map-${name}.ts`, web)));
for (const [engine, folder] of Object.entries({ page: null, ...job.engines })) {
  const apply = folder && JSON.stringify(resolve(folder, "lightwell.js"));
  const entry = folder ? `import { applyLightMap } from ${apply};\nimport { show } from ${page(engine)};\nshow(applyLightMap);` : `import ${page(engine)};`;
  if (folder) site.put(`/${engine}/light_map.bin`, readFileSync(join(folder, "light_map.bin")));
  const { page: tab, errors } = await openPage(browser, 64, 64);
  await tab.goto(site.put(`/${engine}.html`, modulePage(await bundle(entry))));
  await tab.waitForFunction(() => "shoot" in window, { timeout: 60_000 });
  const picture = await tab.evaluate((frame) => window.shoot(frame), { ...job.frame, glb, folder: `/${engine}/` });
  writeFileSync(join(job.out, `${engine}.rgb`), Uint8Array.from(picture));
  problems[engine] = errors;
  await tab.close();
}
await browser.close();
await site.close();
process.stdout.write(JSON.stringify(problems), () => process.exit());
