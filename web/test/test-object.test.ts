/** The page of a bake with probes: a test object that they light, moved by its controls; it is not there where a picture is compared. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect, it } from "vitest";
import { launch, openPage, Site } from "./support/browser.ts";
import { furnishedRoom } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";
import { pageWith } from "./support/page.ts";

/** See `lit-objects.test.ts`. */
const BAKED = readFileSync(fileURLToPath(new URL("fixtures/field-and-probes.glb", import.meta.url)));
/** Into the room of the lamp. */
const HOME = { position: [-1.5, 1.2, 1.3], target: [-1.5, 1.1, -1], up: [0, 1, 0], fovY: 60 };

let browser: Browser;
let page: Page;
let errors: string[];
const site = new Site();

beforeAll(async () => {
  await site.open();
  browser = await launch("swiftshader");
  ({ page, errors } = await openPage(browser, 900, 600, 0.25));
  await page.goto(`${site.put("/index.html", pageWith(BAKED, { home: HOME, exposure: 1 }))}?mode=learned`);
  await page.evaluate(() => window.lightwell.ready);
}, 180_000);

afterAll(async () => {
  await browser?.close();
  await site.close();
  expect(errors).toEqual([]);
});

/** Radiance of the picture, and how much of it is another than before. */
const shot = () => page.evaluate(() => [...window.lightwell.readRadiance().data]);
const apart = (a: number[], b: number[]) => a.filter((x, i) => i % 4 < 3 && Math.abs(x - b[i]!) > 0.02).length / a.length;

it("shows an object that the probes light, and moves it", async () => {
  const section = page.locator("section", { hasText: "Test object" });
  await section.waitFor();
  const there = await shot();
  await section.locator("input[type=checkbox]").uncheck();
  const gone = await shot();
  expect(apart(there, gone)).toBeGreaterThan(2e-3);
  // What took its place before is no black hole: the room is lit.
  const lit = there.filter((x, i) => i % 4 === 0 && Math.abs(x - gone[i]!) > 0.02);
  expect(lit.reduce((sum, x) => sum + x, 0) / lit.length).toBeGreaterThan(0.02);
  await section.locator("input[type=checkbox]").check();
  expect(apart(await shot(), there)).toBe(0);
  await section.locator("input[type=range]").fill("0.2");
  const moved = await shot();
  expect(apart(moved, there)).toBeGreaterThan(2e-3);
});

it("is not offered where a file has no probes", async () => {
  const other = await openPage(browser, 900, 600, 0.25);
  await other.page.goto(`${site.put("/plain.html", pageWith(writeGlb(furnishedRoom())))}?mode=learned`);
  await other.page.evaluate(() => window.lightwell.ready);
  expect(await other.page.locator("section", { hasText: "Test object" }).count()).toBe(0);
  await other.page.close();
});
