// What learned light costs beside an ordinary light map, side by side in one run: node tools/shading-cost.mjs PAGE.html [ROUNDS] [WIDTHxHEIGHT]
// Prints JSON: median milliseconds of both modes and of direct light, median of the ratios, on each software rasteriser.
import { createRequire } from "node:module";
import { existsSync } from "node:fs";
import { pathToFileURL } from "node:url";

const { chromium } = createRequire(new URL("../web/package.json", import.meta.url))("playwright-core");
const [page, rounds = "7", size = "640x400"] = process.argv.slice(2);
const [width, height] = size.split("x").map(Number);
const executablePath = [process.env.CHROMIUM, "/usr/bin/chromium", "/usr/bin/google-chrome"].find((p) => p && existsSync(p));
const BACKENDS = {
  swiftshader: ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
  llvmpipe: ["--use-angle=gl-egl", "--ignore-gpu-blocklist"],
};
const median = (values) => [...values].sort((a, b) => a - b)[values.length >> 1];
const results = {};
for (const [backend, args] of Object.entries(BACKENDS)) {
  const browser = await chromium.launch({ executablePath, args: ["--no-sandbox", "--disable-gpu-watchdog", ...args] });
  const tab = await browser.newPage({ viewport: { width, height } });
  tab.setDefaultTimeout(300_000);
  await tab.goto(`${pathToFileURL(page).href}?size=${size}&ui=0&samples=0`);
  await tab.waitForFunction(() => window.lightwell !== undefined);
  results[backend] = await tab.evaluate(
    async ([count]) => {
      await window.lightwell.ready;
      if (!window.lightwell.stats().lightmaps) throw new Error("the file carries no ordinary light map");
      const time = async (mode) => {
        await window.lightwell.setMode(mode);
        window.lightwell.measure(1);
        return window.lightwell.measure(5);
      };
      const found = { lightmap: [], learned: [], direct: [] };
      for (let i = 0; i < count; i++) for (const mode of Object.keys(found)) found[mode].push(await time(mode));
      return { ...found, renderer: window.lightwell.stats().renderer, macs: window.lightwell.stats().macs };
    },
    [Number(rounds)],
  );
  await browser.close();
}
const rows = Object.entries(results).map(([backend, { lightmap, learned, direct, renderer, macs }]) => [
  backend,
  {
    renderer,
    macs,
    lightmap_ms: median(lightmap),
    learned_ms: median(learned),
    direct_ms: median(direct),
    ratio: median(learned.map((ms, i) => ms / lightmap[i])),
  },
]);
console.log(JSON.stringify(Object.fromEntries(rows)));
