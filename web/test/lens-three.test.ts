/** The lens behind a pass of three.js' WebGPURenderer, driven by its live depth buffer and velocity. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, beforeEach, describe, expect, it } from "vitest";
import type { ThreeRequest } from "./pages/lens-three.ts";
import { launch, openPage, Site } from "./support/browser.ts";
import { bundle, modulePage } from "./support/bundle.ts";

const library = (name: string) => readFileSync(fileURLToPath(new URL(`../../lightwell/lens/standard/${name}.lwsp`, import.meta.url))).toString("base64");
const libraries = [library("disc-32"), library("disc-16-speed-32")];
const site = new Site();
let browser: Browser | undefined;
let page: Page;
let errors: string[] = [];
let adapter = false;

beforeAll(async () => {
  await site.open();
  browser = await launch("swiftshader");
  ({ page, errors } = await openPage(browser));
  await page.goto(site.put("/index.html", modulePage(await bundle("pages/lens-three.ts"))));
  await page.waitForFunction(() => window.lensThreeReady);
  adapter = await page.evaluate(async () => Boolean(await navigator.gpu?.requestAdapter()));
}, 90_000);

afterAll(async () => {
  await browser?.close();
  await site.close();
  expect(errors).toEqual([]);
});

beforeEach((context) => {
  if (!adapter) context.skip("this browser has no WebGPU adapter");
});

/** Depth of either direction; the one that is harder to read in every test. */
const REVERSED = process.env.LIGHTWELL_LONG_TESTS ? [true, false] : [true];

const draw = (change: Partial<ThreeRequest>) =>
  page.evaluate((request) => window.lensThree(request), { libraries, reversed: true, enabled: true, blur: 0, speed: 0, ...change });
/** The square reaches from pixel 24 to 40. */
const covered = (row: number[]) => row.map((v) => Number(v.toFixed(2)));

describe.each(REVERSED)("a lens node, reversed depth: %s", (reversed) => {
  it("switched off or without blur it changes nothing", async () => {
    const square = Array.from({ length: 64 }, (_, x) => Number(x >= 24 && x < 40));
    expect(covered(await draw({ reversed, enabled: false, blur: 6 }))).toEqual(square);
    expect(covered(await draw({ reversed }))).toEqual(square);
  });

  it("a near square spills over the wall in focus by its circle of confusion", async () => {
    const row = await draw({ blur: 6, reversed });
    expect(Math.max(...row.slice(0, 17))).toBeLessThan(2e-3);
    expect(row[19]).toBeGreaterThan(0.01);
    expect(row[19]).toBeLessThan(0.2);
    // Half covered at its edge, fully in its middle.
    expect(Math.abs((row[23]! + row[24]!) / 2 - 0.5)).toBeLessThan(0.03);
    expect(row[31]).toBeGreaterThan(0.95);
  });

  it("what moves is blurred along its motion, what rests is not", async () => {
    const [still, moving] = [await draw({ reversed, blur: 3 }), await draw({ reversed, blur: 3, speed: 8 })];
    expect(Math.max(...still.slice(0, 20))).toBeLessThan(5e-3);
    // Half of the way to either side of the edge, on top of the blur.
    expect(moving[20]!).toBeGreaterThan(0.08);
    expect(Math.abs((moving[23]! + moving[24]!) / 2 - 0.5)).toBeLessThan(0.03);
    expect(moving[26]!).toBeLessThan(0.9);
    expect(Math.max(...moving.slice(0, 16))).toBeLessThan(5e-3);
    expect(moving[31]!).toBeGreaterThan(0.95);
  });
});

it("a lens that is disposed of leaves no buffer", async () => {
  await draw({});
  const { left, stands } = await page.evaluate(() => window.lensThreeDispose());
  expect(stands).toBeGreaterThan(0);
  expect(left).toBe(0);
});
