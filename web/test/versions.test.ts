/**
 * Every version of three.js that the package says it works with draws the same picture. All other tests run with the newest one; the
 * older ones, installed as `three-0.NNN`, run in the long tests and where figures are measured (vitest.config.ts).
 */

import { existsSync } from "node:fs";
import { fileURLToPath } from "node:url";
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, describe, expect, it } from "vitest";
import type { Request } from "./pages/renderers.ts";
import { launch, openPage, Site } from "./support/browser.ts";
import { bundle, modulePage } from "./support/bundle.ts";
import { keepFigure } from "./support/figures.ts";
import { CAMERA, furnishedRoom } from "./support/fixtures.ts";
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

  /** The room as a version draws it, direct light and shadows included. */
  async function picture(kind: Request["kind"], three?: string): Promise<number[]> {
    const { page, errors } = await openPage(browser);
    const code = await bundle("pages/renderers.ts", three ? { three } : {});
    await page.goto(site.put(`/${three ?? "newest"}.html`, modulePage(code)));
    await page.waitForFunction(() => window.ready);
    const camera = { position: CAMERA.position, target: CAMERA.target, fovY: CAMERA.fov_y } as Request["camera"];
    const { data, backend } = await page.evaluate((request) => window.draw(request), { glb, kind, width: 96, height: 72, camera, direct: true });
    expect(backend).toBe(kind);
    expect(errors).toEqual([]);
    await page.close();
    return data;
  }

  describe.each(["webgl", "webgpu"] as const)("on %s", (kind) => {
    it.each(OLDER)("%s draws as the newest", async (name) => {
      expect(existsSync(fileURLToPath(new URL(`../node_modules/${name}`, import.meta.url)))).toBe(true);
      const decibels = psnr(await picture(kind), await picture(kind, name));
      keepFigure(`${name} on ${kind}, dB`, decibels);
      expect(decibels).toBeGreaterThan(ALIKE);
    }, 120_000);
  });
});
