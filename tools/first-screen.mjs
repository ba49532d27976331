// What a reader sees without scrolling: node tools/first-screen.mjs PAGE.html WIDTHxHEIGHT SELECTOR ...
// Prints one line of JSON per selector: where its first element ends, and whether that is on the screen; exit code 1 when one is not.
// Needs the web tests' packages and a Chromium.
import { existsSync } from "node:fs";
import { createRequire } from "node:module";
import { resolve } from "node:path";
import { pathToFileURL } from "node:url";

const { chromium } = createRequire(new URL("../web/package.json", import.meta.url))("playwright-core");
const [page, size, ...selectors] = process.argv.slice(2);
const [width, height] = size.split("x").map(Number);
const executablePath = [process.env.CHROMIUM, "/usr/bin/chromium", "/usr/bin/google-chrome"].find((p) => p && existsSync(p));
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
const tab = await browser.newPage({ viewport: { width, height } });
await tab.goto(pathToFileURL(resolve(page)).href);
for (const selector of selectors) {
  const box = await tab.locator(selector).first().boundingBox();
  const bottom = box === null ? null : Math.round(box.y + box.height);
  const seen = box !== null && box.height > 0 && bottom <= height;
  if (!seen) process.exitCode = 1;
  console.log(JSON.stringify({ selector, bottom, seen }));
}
await browser.close();
