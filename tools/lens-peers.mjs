// Frames through depth of field in headless Chromium, ours and others': node tools/lens-peers.mjs JOB.json
//
// JOB      { "frame": as PeerFrame in web/test/pages/lens-peers.ts, "color" and "depth" being paths of float32 files,
//            "libraries" paths of .lwsp files; "draws": [{ "name", "setting", "rounds", "out": path of the float32 picture }] }
// Prints JSON: { "adapter", "draws": [{ "milliseconds" } | { "error" }] } in the order of the job.
import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { fileURLToPath, pathToFileURL } from "node:url";

const web = new URL("../web/", import.meta.url);
const { runnerImport } = await import(pathToFileURL(createRequire(new URL("package.json", web)).resolve("vite")).href);
const load = async (path) =>
  (await runnerImport(fileURLToPath(new URL(path, web)), { configFile: false, logLevel: "error", root: fileURLToPath(web) })).module;
const { bundle, modulePage } = await load("test/support/bundle.ts");
const { launch, openPage, Site } = await load("test/support/browser.ts");

const job = JSON.parse(readFileSync(process.argv[2], "utf8"));
const base64 = (path) => readFileSync(path).toString("base64");
const frame = { ...job.frame, color: base64(job.frame.color), depth: base64(job.frame.depth), libraries: job.frame.libraries.map(base64) };
const site = new Site();
await site.open();
const browser = await launch("swiftshader");
const { page, errors } = await openPage(browser, 64, 64);
page.setDefaultTimeout(300_000);
await page.goto(site.put("/index.html", modulePage(await bundle("pages/lens-peers.ts"))));
await page.waitForFunction(() => window.peersReady);
const adapter = await page.evaluate(() => window.peersAdapter());
await page.evaluate((given) => window.peersFrame(given), frame);
const draws = [];
for (const { name, setting, rounds, out } of job.draws) {
  try {
    const { picture, milliseconds } = await page.evaluate(([n, s, r]) => window.peersDraw(n, s, r), [name, setting, rounds]);
    writeFileSync(out, Buffer.from(picture, "base64"));
    draws.push({ milliseconds });
  } catch (error) {
    draws.push({ error: String(error).split("\n")[0] });
  }
}
await browser.close();
await site.close();
process.stdout.write(JSON.stringify({ adapter, draws, errors: errors.slice(0, 5) }));
