// Frames of a baked page while its light changes: node tools/moving-picture.mjs PAGE.html PLAN.json FRAMES.bin
// PLAN: { size: [width, height], view or camera: [position, target, fovY], intensity?, exposure?, lamps: [[x, y, z], ...] or queries:
// ["movers=Door:45", ...] }. FRAMES: for each of them the canvas with direct light alone, then with learned light; RGBA, 8 bits.
// tools/moving_picture.py calls it.
import { existsSync, readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const { chromium } = createRequire(new URL("../web/package.json", import.meta.url))("playwright-core");
const [page, planFile, out] = process.argv.slice(2);
const plan = JSON.parse(readFileSync(planFile, "utf8"));
const [width, height] = plan.size;
const executablePath = [process.env.CHROMIUM, "/usr/bin/chromium", "/usr/bin/google-chrome"].find((p) => p && existsSync(p));
const browser = await chromium.launch({
  executablePath,
  args: ["--no-sandbox", "--disable-gpu-watchdog", "--use-angle=gl-egl", "--ignore-gpu-blocklist"],
});
const tab = await browser.newPage({ viewport: { width, height } });
tab.setDefaultTimeout(600_000);
tab.on("pageerror", (error) => console.error(String(error)));
const exposure = plan.exposure ? `&exposure=${plan.exposure}` : "";
await tab.goto(`${pathToFileURL(page).href}?mode=learned&ui=0&size=${width}x${height}${exposure}`);
await tab.waitForFunction(() => window.lightwell !== undefined);
await tab.evaluate(async (plan) => {
  await window.lightwell.ready;
  if (plan.camera) window.lightwell.setCamera(...plan.camera);
  else await window.lightwell.setView(plan.view ?? 0);
  if (plan.intensity !== undefined) window.lightwell.setIntensity(plan.intensity);
}, plan);

const frames = [];
const steps = plan.queries ?? plan.lamps;
for (const [index, step] of steps.entries()) {
  for (const mode of ["direct", "learned"]) {
    const text = await tab.evaluate(
      async ([step, mode]) => {
        if (typeof step === "string") await window.lightwell.apply(`?${step}`);
        else window.lightwell.setLight(step);
        await window.lightwell.setMode(mode);
        window.lightwell.renderOnce();
        const { data } = window.lightwell.readPixels();
        let text = "";
        for (let i = 0; i < data.length; i += 32768) text += String.fromCharCode(...data.subarray(i, i + 32768));
        return btoa(text);
      },
      [step, mode],
    );
    frames.push(Buffer.from(text, "base64"));
  }
  if (index % 8 === 0) console.error(`${index + 1} of ${steps.length}`);
}
writeFileSync(out, Buffer.concat(frames));
await browser.close();
