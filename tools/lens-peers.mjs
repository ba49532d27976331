// Frames through depth of field in headless Chromium, ours and others': node tools/lens-peers.mjs JOB.json
//
// JOB      { "frame": as PeerFrame in web/test/pages/lens-peers.ts, "color" and "depth" being paths of float32 files,
//            "libraries" paths of .lwsp files; "draws": [{ "name", "setting", "rounds", "out": path of the float32 picture }];
//            "limit": seconds that one draw may take }
// Prints JSON: { "adapter", "draws": [{ "milliseconds" } | { "error" }] } in the order of the job. Once a draw took too long, its
// name is not tried again, and the others go on in another browser.
import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { fileURLToPath, pathToFileURL } from "node:url";

const web = new URL("../web/", import.meta.url);
const { runnerImport } = await import(pathToFileURL(createRequire(new URL("package.json", web)).resolve("vite")).href);
const load = async (path) =>
  (await runnerImport(fileURLToPath(new URL(path, web)), { configFile: false, logLevel: "error", root: fileURLToPath(web) })).module;
const { bundle, modulePage } = await load("test/support/bundle.ts");
const { launchAlone, openPage, Site } = await load("test/support/browser.ts");

const job = JSON.parse(readFileSync(process.argv[2], "utf8"));
const base64 = (path) => readFileSync(path).toString("base64");
const frame = { ...job.frame, color: base64(job.frame.color), depth: base64(job.frame.depth), libraries: job.frame.libraries.map(base64) };
const site = new Site();
await site.open();
const address = site.put("/index.html", modulePage(await bundle("pages/lens-peers.ts")));
const errors = [];

/** What `work` gives; null where it takes longer than `seconds`. */
async function within(seconds, work) {
  let timer;
  const late = new Promise((resolve) => (timer = setTimeout(() => resolve(null), 1000 * seconds)));
  return Promise.race([work, late]).finally(() => clearTimeout(timer));
}

async function start() {
  // Not the browser that tests share, which stays open for as long as this process is there.
  const browser = await launchAlone("swiftshader");
  const opened = await openPage(browser, 64, 64);
  const { page } = opened;
  page.setDefaultTimeout(300_000);
  await page.goto(address);
  await page.waitForFunction(() => window.peersReady);
  await page.evaluate((given) => window.peersFrame(given), frame);
  // A page that hangs may not let itself be closed.
  return { page, close: () => (errors.push(...opened.errors), within(10, browser.close())) };
}

let open = await start();
const adapter = await open.page.evaluate(() => window.peersAdapter());
const draws = [];
const late = new Set();
for (const { name, setting, rounds, out } of job.draws) {
  const tooLong = { error: `${name} did not finish in this browser within ${job.limit} s` };
  if (late.has(name)) {
    draws.push(tooLong);
    continue;
  }
  try {
    const work = open.page.evaluate(([n, s, r]) => window.peersDraw(n, s, r), [name, setting, rounds]);
    const drawn = await within(job.limit, work);
    if (drawn) {
      writeFileSync(out, Buffer.from(drawn.picture, "base64"));
      draws.push({ milliseconds: drawn.milliseconds });
    } else {
      work.catch(() => {});
      late.add(name);
      draws.push(tooLong);
      await open.close();
      open = await start();
    }
  } catch (error) {
    draws.push({ error: String(error).split("\n")[0] });
  }
}
await open.close();
await site.close();
// Ends browsers that could not be closed, too.
process.stdout.write(JSON.stringify({ adapter, draws, errors: errors.slice(0, 5) }), () => process.exit());
