// Accessibility and width of built pages: node tools/check-site.mjs FOLDER [PAGE ...]
// For each page, on a desktop (1280 px) and on a phone (390 px): violations that axe finds, and whether it scrolls sideways.
// Prints one line of JSON per page; exit code 1 when something is wrong. Needs the web tests' packages and a Chromium.
import { existsSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { resolve } from "node:path";
import { pathToFileURL } from "node:url";

const require = createRequire(new URL("../web/package.json", import.meta.url));
const { chromium } = require("playwright-core");
const axe = readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");
const [folder, ...pages] = process.argv.slice(2);
const executablePath = [process.env.CHROMIUM, "/usr/bin/chromium", "/usr/bin/google-chrome"].find((p) => p && existsSync(p));
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });
let wrong = false;
for (const page of pages) {
  for (const width of [1280, 390]) {
    const tab = await browser.newPage({ viewport: { width, height: 800 } });
    await tab.goto(pathToFileURL(resolve(folder, page)).href);
    await tab.evaluate(axe);
    const found = await tab.evaluate(() => window.axe.run(document, { resultTypes: ["violations"] }));
    const violations = found.violations.map(({ id, nodes }) => `${id} (${nodes.length}): ${nodes[0].html.slice(0, 120)}`);
    const sideways = await tab.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
    wrong ||= violations.length > 0 || sideways > 0;
    console.log(JSON.stringify({ page, width, violations, sideways }));
    await tab.close();
  }
}
await browser.close();
process.exitCode = wrong ? 1 : 0;
