// Pictures of a baked page at its saved views, learned and reference: node tools/page_views.mjs PAGE.html FOLDER [WIDTHxHEIGHT] [SECONDS]
// Writes FOLDER/VIEW-learned.png and FOLDER/VIEW-reference.png of every view that has a reference, and prints stats() as JSON.
// Ends with code 1 when the page has an error or does not draw within SECONDS. Needs the web tests' packages (npm ci in web/).
import { createRequire } from "node:module";
import { existsSync, mkdirSync, writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const { chromium } = createRequire(new URL("../web/package.json", import.meta.url))("playwright-core");
const [page, folder, size = "640x400", seconds = "300"] = process.argv.slice(2);
const [width, height] = size.split("x").map(Number);
const executablePath = [process.env.CHROMIUM, "/usr/bin/chromium", "/usr/bin/google-chrome"].find((p) => p && existsSync(p));
const browser = await chromium.launch({
  executablePath,
  args: ["--no-sandbox", "--disable-gpu-watchdog", "--use-angle=gl-egl", "--ignore-gpu-blocklist"],
});
const fail = (message) => {
  console.error(message);
  process.exit(1);
};
setTimeout(() => fail(`the page does not draw within ${seconds} s`), 1000 * Number(seconds)).unref();
const tab = await browser.newPage({ viewport: { width, height } });
tab.setDefaultTimeout(1000 * Number(seconds));
tab.on("pageerror", (error) => fail(`the page has an error: ${error}`));
mkdirSync(folder, { recursive: true });
await tab.goto(`${pathToFileURL(page).href}?mode=learned&view=0&ui=0`);
await tab.waitForFunction(() => window.lightwell !== undefined);
await tab.evaluate(() => window.lightwell.ready);
const { views } = await tab.evaluate(() => window.lightwell.stats());
for (let view = 0; view < views; view++) {
  for (const mode of ["learned", "reference"]) {
    await tab.evaluate(
      async ([index, name]) => {
        // The lamps of a view are placed when it is shown as learned.
        await window.lightwell.setMode(name);
        await window.lightwell.setView(index);
        window.lightwell.renderOnce();
      },
      [view, mode],
    );
    // A page without a reference of this view stays in its mode.
    if ((await tab.evaluate(() => window.lightwell.stats().mode)) !== mode) continue;
    const url = await tab.evaluate(async () => {
      const { width, height, data } = window.lightwell.readPixels();
      const canvas = new OffscreenCanvas(width, height);
      canvas.getContext("2d").putImageData(new ImageData(new Uint8ClampedArray(data), width, height), 0, 0);
      const bytes = new Uint8Array(await (await canvas.convertToBlob({ type: "image/png" })).arrayBuffer());
      return btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
    });
    writeFileSync(`${folder}/${view}-${mode}.png`, Buffer.from(url, "base64"));
  }
}
console.log(JSON.stringify(await tab.evaluate(() => window.lightwell.stats())));
await browser.close();
