/**
 * Every version of three.js that the package says it works with draws the same picture. `make test` runs the newest one in all other
 * tests; the older ones run with `LIGHTWELL_LONG_TESTS=1`, where they are installed as `three-0.NNN`.
 */

import { existsSync } from "node:fs";
import { fileURLToPath } from "node:url";
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, describe, expect, it } from "vitest";
import type { Result } from "./pages/three-ways.ts";
import { launch, openPage, Site } from "./support/browser.ts";
import { bundle, modulePage } from "./support/bundle.ts";
import { furnishedRoom } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";

const OLDER = ["three-0.182", "three-0.184"];
/** Decibels between two pictures, for a peak of 1. */
const ALIKE = 45;

const psnr = (a: readonly number[], b: readonly number[]): number =>
  -10 * Math.log10(a.reduce((sum, x, i) => sum + (x - b[i]!) ** 2, 0) / a.length + 1e-12);

describe("three.js", () => {
  let browser: Browser;
  const site = new Site();
  const glb = Buffer.from(writeGlb(furnishedRoom())).toString("base64");

  beforeAll(async () => {
    await site.open();
    browser = await launch("swiftshader");
  });

  afterAll(async () => {
    await browser?.close();
    await site.close();
  });

  async function pictures(three?: string): Promise<Result<"placed">> {
    const { page, errors } = await openPage(browser);
    const code = await bundle("pages/three-ways.ts", three ? { three } : {});
    await page.goto(site.put(`/${three ?? "newest"}.html`, modulePage(code, `<body data-glb="${glb}">`)));
    await page.waitForFunction(() => window.scenario);
    const found = (await page.evaluate(() => window.scenario("placed"))) as Result<"placed">;
    expect(errors).toEqual([]);
    await page.close();
    return found;
  }

  it.each(OLDER)("%s draws as the newest", async (name) => {
    expect(existsSync(fileURLToPath(new URL(`../node_modules/${name}`, import.meta.url)))).toBe(true);
    const [newest, older] = [await pictures(), await pictures(name)];
    for (const [i, picture] of newest.entries()) expect(psnr(picture, older[i]!)).toBeGreaterThan(ALIKE);
  }, 120_000);
});
