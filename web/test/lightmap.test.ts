/** A neural light map on the page: the ordinary light map beside it, the split between them, the pictures one by one. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect, it } from "vitest";
import type { Mode } from "../viewer/src/modes.ts";
import { COARSE, launch, openPage, Site } from "./support/browser.ts";
import { pageWith } from "./support/page.ts";

const [WIDTH, HEIGHT] = [128, 96];
const GLB = readFileSync(fileURLToPath(new URL("fixtures/lightmap.glb", import.meta.url)));
const QUERY = `?size=${WIDTH}x${HEIGHT}&tonemap=none&exposure=1&dither=0&samples=0`;
const HOME = { position: [0.4, 1.1, 2.6], target: [0, 0.7, -0.4], up: [0, 1, 0], fov_y: 45 };
/** Albedo of the wall, and irradiance per texel value (tools/lightmap_example.py). */
const [WALL, INTENSITY] = [[0.7, 0.7, 0.8], 2];

let browser: Browser;
/** Without controls, to be measured; and with them. */
let page: Page;
let whole: Page;
const errors: string[] = [];
const site = new Site();

beforeAll(async () => {
  await site.open();
  browser = await launch("llvmpipe");
  const url = site.put("/index.html", pageWith(GLB, { title: "Light map", home: HOME })) + QUERY;
  const open = async (width: number, height: number, query: string, scale = 1) => {
    const tab = await openPage(browser, width, height, scale);
    tab.page.on("close", () => errors.push(...tab.errors));
    await tab.page.goto(url + query);
    await tab.page.evaluate(() => window.lightwell.ready);
    return tab.page;
  };
  page = await open(WIDTH, HEIGHT, "&ui=0");
  whole = await open(760, 480, "", COARSE);
});

afterAll(async () => {
  await page?.close();
  await whole?.close();
  await browser?.close();
  await site.close();
  expect(errors).toEqual([]);
});

const pixels = async (mode: Mode) => {
  await page.evaluate((name) => window.lightwell.setMode(name), mode);
  return page.evaluate(() => Array.from(window.lightwell.readPixels().data));
};
const rgb = (data: number[], x: number, y: number) => data.slice(4 * (y * WIDTH + x), 4 * (y * WIDTH + x) + 3);

it("shows an ordinary light map as albedo · E / π, and does not add it to the learned light", async () => {
  await page.evaluate(() => window.lightwell.setMode("lightmap"));
  const read = () => page.evaluate(() => Array.from(window.lightwell.readRadiance().data));
  const at = (values: number[], x: number) => values.slice(4 * (20 * WIDTH + x), 4 * (20 * WIDTH + x) + 4) as [number, number, number, number];
  const places = Array.from({ length: 9 }, (_, k) => 40 + 6 * k);
  let data = await read();
  const seen = () => places.filter((x) => at(data, x)[3] > 0);
  // On a busy machine the browser may still link the program of the mode, and the picture is empty.
  await expect.poll(async () => ((data = await read()), seen().length), { timeout: 10_000 }).toBeGreaterThan(3);
  for (const x of seen()) {
    const color = at(data, x);
    // The ramp runs from 0.3 to 0.8 in red and green, and from 0.6 down to 0.4 in blue.
    for (const [c, low, high] of [[0, 0.3, 0.8], [1, 0.3, 0.8], [2, 0.4, 0.6]] as const) {
      const texel = (color[c]! * Math.PI) / (WALL[c]! * INTENSITY);
      expect(texel).toBeGreaterThan(low - 0.03);
      expect(texel).toBeLessThan(high + 0.03);
    }
  }
  await page.evaluate(() => window.lightwell.setStillLight(false));
  const dark = await page.evaluate(() => Array.from(window.lightwell.readRadiance().data));
  expect(Math.max(...dark.filter((_, i) => i % 4 !== 3))).toBe(0);
  await page.evaluate(() => window.lightwell.setStillLight(true));
});

it("splits the screen between both, where the handle is", async () => {
  const [learned, lightmap] = [await pixels("learned"), await pixels("lightmap")];
  await page.evaluate(() => window.lightwell.setSplit(0.5, "lightmap"));
  const split = await pixels("split");
  let differing = 0;
  for (let y = 8; y < HEIGHT; y += 8) {
    for (let x = 4; x < WIDTH; x += 6) {
      if (Math.abs(x - WIDTH / 2) < 2) continue;
      expect(rgb(split, x, y)).toEqual(rgb(x < WIDTH / 2 ? lightmap : learned, x, y));
      if (rgb(learned, x, y).join() !== rgb(lightmap, x, y).join()) differing++;
    }
  }
  expect(differing).toBeGreaterThan(20);
});

it("offers what the file has, and says what it costs", async () => {
  const stats = await whole.evaluate(() => window.lightwell.stats());
  expect(stats).toMatchObject({ lightmaps: true, fileBytes: GLB.length });
  const modes = await whole.locator(".modes button:visible").allInnerTexts();
  expect(modes).toEqual(["Learned", "Direct", "Indirect", "Split", "Light map"]);
  const numbers = await whole.locator(".numbers").innerText();
  expect(numbers).toMatch(/File\s+6\.5 kB/);
  expect(numbers).toMatch(/Learned data\s+0\.\d kB/);
});

it("shows every picture, channel by channel", async () => {
  expect(await whole.locator(".texture").count()).toBe(3);
  await whole.locator(".texture").first().click();
  const sheet = whole.locator("dialog.inspector");
  expect(await sheet.innerText()).toContain("16 × 16");
  const read = () => sheet.locator("canvas").evaluate((canvas: HTMLCanvasElement) => [...canvas.getContext("2d")!.getImageData(15, 0, 1, 1).data]);
  // Red grows to the right, green downwards: the top right texel (tools/lightmap_example.py).
  const [r, g, b] = await read();
  expect([r, g, b]).toEqual([204, 76, 153]);
  await sheet.getByRole("radio", { name: "G", exact: true }).click();
  expect(await read()).toEqual([76, 76, 76, 255]);
  await whole.keyboard.press("Escape");
  await expect.poll(() => sheet.count()).toBe(0);
});
