// Screenshots of baked pages: node tools/screenshot.mjs OUT.png PAGE.html "mode=learned&view=0&ui=0" [WIDTHxHEIGHT]
// A report has no scene: node tools/screenshot.mjs OUT.png report.html. Needs the web tests' packages (npm ci in web/). Uses llvmpipe where Mesa is installed, SwiftShader otherwise.
import { createRequire } from "node:module";
import { existsSync } from "node:fs";
import { pathToFileURL } from "node:url";

const { chromium } = createRequire(new URL("../web/package.json", import.meta.url))("playwright-core");
const [out, page, query = "", size = "1280x800"] = process.argv.slice(2);
const [width, height] = size.split("x").map(Number);
const executablePath = [process.env.CHROMIUM, "/usr/bin/chromium", "/usr/bin/google-chrome"].find((p) => p && existsSync(p));
const browser = await chromium.launch({
  executablePath,
  args: ["--no-sandbox", "--disable-gpu-watchdog", "--use-angle=gl-egl", "--ignore-gpu-blocklist"],
});
const tab = await browser.newPage({ viewport: { width, height } });
tab.setDefaultTimeout(1_800_000);
tab.on("pageerror", (error) => console.error(String(error)));
await tab.goto(`${pathToFileURL(page).href}?${query}`);
const hasScene = !/(report|compare)\.html$/.test(page);
if (hasScene) {
  await tab.waitForFunction(() => window.lightwell !== undefined);
  await tab.evaluate(async () => {
    await window.lightwell.ready;
  });
  await tab.waitForTimeout(3000);
  await tab.evaluate(() => window.lightwell.renderOnce());
}
await tab.screenshot({ path: out, timeout: 1_800_000 });
if (hasScene) console.log(JSON.stringify(await tab.evaluate(() => window.lightwell.stats())));
await browser.close();
