// What a frame costs while switches change, on two pages side by side in one run: node tools/lamp-frames.mjs ONE.html MANY.html [ROUNDS] [WIDTHxHEIGHT]
// Both hold one scene, MANY with more lamps than ONE. Before every frame all lamps get other dimmers, so that layers are added up anew. Prints JSON: for each software rasteriser median milliseconds of both pages and the median of the ratios of neighbours.
import { existsSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const { chromium } = createRequire(new URL("../web/package.json", import.meta.url))("playwright-core");
const [one, many, rounds = "9", size = "640x400"] = process.argv.slice(2);
const [width, height] = size.split("x").map(Number);
/** Names that lamps may have here: one group of all lights, or sixteen groups (benchmarks/sixteen_lamps.py). */
const asked = ["lights", ...Array.from({ length: 16 }, (_, k) => `lamp ${k + 1}`)];
/** Frames of a measurement. */
const FRAMES = 8;
const executablePath = [process.env.CHROMIUM, "/usr/bin/chromium", "/usr/bin/google-chrome"].find((p) => p && existsSync(p));
const BACKENDS = {
  swiftshader: ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
  llvmpipe: ["--use-angle=gl-egl", "--ignore-gpu-blocklist"],
};
const median = (values) => [...values].sort((a, b) => a - b)[values.length >> 1];

async function open(browser, file) {
  const tab = await browser.newPage({ viewport: { width, height } });
  tab.setDefaultTimeout(300_000);
  await tab.goto(`${pathToFileURL(file).href}?mode=learned&size=${size}&ui=0&samples=0`);
  await tab.waitForFunction(() => window.lightwell !== undefined);
  const stats = await tab.evaluate(() => window.lightwell.ready.then(() => window.lightwell.stats()));
  // A dimmed lamp is in the address that shows the same; those that are not there are not known to the page.
  await tab.evaluate((query) => window.lightwell.apply(query), `?lamps=${encodeURIComponent(asked.map((name) => `${name}:0.5`).join(";"))}`);
  const shown = new URL(await tab.evaluate(() => window.lightwell.link())).searchParams.get("lamps") ?? "";
  return { tab, ...stats, lamps: shown.split(";").filter(Boolean).map((entry) => entry.split(":")[0]) };
}

/** Milliseconds of a frame: the dimmers change and it is drawn, FRAMES times, and then once more, which waits for all of them. */
const time = ({ tab, lamps }, round) =>
  tab.evaluate(
    async ([names, round, frames]) => {
      const change = (frame) => {
        const dimmers = names.map((name, k) => `${name}:${(0.5 + ((7 * k + 3 * round + frame) % 10) / 20).toFixed(2)}`);
        return window.lightwell.apply(`?lamps=${encodeURIComponent(dimmers.join(";"))}`);
      };
      await change(frames);
      window.lightwell.measure(1);
      const start = performance.now();
      for (let frame = 0; frame < frames; frame++) await change(frame);
      window.lightwell.measure(1);
      return (performance.now() - start) / (frames + 1);
    },
    [lamps, round, FRAMES],
  );

const results = {};
for (const [backend, args] of Object.entries(BACKENDS)) {
  const browser = await chromium.launch({ executablePath, args: ["--no-sandbox", "--disable-gpu-watchdog", ...args] });
  const pages = [await open(browser, one), await open(browser, many)];
  const found = [[], []];
  for (let round = 0; round < Number(rounds); round++) {
    // Which comes first alternates.
    for (const k of round % 2 ? [1, 0] : [0, 1]) {
      await pages[k].tab.bringToFront();
      found[k].push(await time(pages[k], round));
    }
  }
  results[backend] = {
    renderer: pages[0].renderer,
    lamps: pages.map((page) => page.lamps.length),
    macs: pages.map((page) => page.macs),
    one_ms: median(found[0]),
    many_ms: median(found[1]),
    ratio: median(found[1].map((ms, i) => ms / found[0][i])),
  };
  await browser.close();
}
console.log(JSON.stringify(results));
