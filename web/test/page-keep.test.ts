/** What visitors take along from the page, how it tells of a download, its shortcuts, and the policy under which it runs. */

import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect, it } from "vitest";
import { COARSE, launch, openPage, Site } from "./support/browser.ts";
import { CAMERA, plainRoom, room } from "./support/fixtures.ts";
import { ball, writeGlb } from "./support/glb.ts";
import { BUILT_PAGE, pageWith } from "./support/page.ts";

let browser: Browser;
let address = "";
let tab: { page: Page; errors: string[] };
const site = new Site();
const html = pageWith(writeGlb(plainRoom()), { home: CAMERA, title: "A room, furnished" });

beforeAll(async () => {
  await site.open();
  browser = await launch("llvmpipe");
  address = site.put("/page.html", html);
  tab = await openPage(browser, 800, 500, COARSE);
  // Large enough to come in several parts.
  site.put("/scene.glb", writeGlb(plainRoom({ meshes: [...room(), ball(0, [0, 1, 0], 0.3, 150)] })));
});

afterAll(async () => {
  await browser?.close();
  await site.close();
});

async function open(url = address): Promise<{ page: Page; errors: string[] }> {
  tab.errors.length = 0;
  await tab.page.goto(url);
  await tab.page.evaluate(() => window.lightwell.ready);
  return tab;
}

it("saves the picture as a PNG of the scene's name, and a turn as a film that ends where it began", async () => {
  const { page, errors } = await open(`${address}?mode=learned&size=160x100`);
  const download = page.waitForEvent("download");
  await page.getByRole("button", { name: "Save picture" }).click();
  const saved = await download;
  expect(saved.suggestedFilename()).toBe("a-room-furnished.png");
  const png = readFileSync((await saved.path())!);
  expect([png.toString("latin1", 1, 4), png.readUInt32BE(16), png.readUInt32BE(20)]).toEqual(["PNG", 160, 100]);
  const film = await page.evaluate(async () => {
    const before = window.lightwell.link();
    const blob = await window.lightwell.recordTurn(0.6);
    const cameras = [before, window.lightwell.link()].map((link) => new URL(link).searchParams.get("camera")!.split(",").map(Number));
    return { head: [...new Uint8Array(await blob.arrayBuffer()).subarray(0, 4)], type: blob.type, size: blob.size, cameras };
  });
  // EBML, in which WebM files begin.
  expect(film.head).toEqual([0x1a, 0x45, 0xdf, 0xa3]);
  expect(film.type).toBe("video/webm");
  expect(film.size).toBeGreaterThan(500);
  film.cameras[1]!.forEach((x, i) => expect(x).toBeCloseTo(film.cameras[0]![i]!, 2));
  expect(errors).toEqual([]);
});

it("single keys are no shortcuts once they are switched off, here and at the next visit, but for the help", async () => {
  const { page } = await open();
  const mode = () => page.evaluate(() => window.lightwell.stats().mode);
  await page.keyboard.press("4");
  expect(await mode()).toBe("direct");
  await page.keyboard.press("?");
  await page.getByRole("switch", { name: "Single keys are shortcuts" }).uncheck();
  await page.keyboard.press("Escape");
  await page.keyboard.press("1");
  expect(await mode()).toBe("direct");
  await page.reload();
  await page.evaluate(() => window.lightwell.ready);
  await page.keyboard.press("4");
  expect(await mode()).not.toBe("direct");
  await page.keyboard.press("?");
  expect(await page.getByRole("dialog").isVisible()).toBe(true);
  // Nothing of what the file has not.
  expect(await page.getByRole("dialog").innerText()).not.toMatch(/Reference:|Experts:/);
  await page.goto(`${address}?keys=1`);
  await page.evaluate(() => window.lightwell.ready);
  await page.keyboard.press("4");
  expect(await mode()).toBe("direct");
});

it("says how much of a file has come", async () => {
  const { page } = await openPage(browser, 400, 300, COARSE);
  await page.addInitScript(() => {
    const told: string[] = ((window as any).told = []);
    addEventListener("DOMContentLoaded", () =>
      new MutationObserver(() => told.push(document.querySelector(".status")?.textContent ?? "")).observe(document.body, { subtree: true, childList: true }),
    );
  });
  await page.goto(`${site.put("/empty.html", readFileSync(BUILT_PAGE, "utf8"))}?asset=/scene.glb`);
  await page.evaluate(() => window.lightwell.ready);
  expect(await page.evaluate(() => (window as any).told.join(" | "))).toMatch(/Loading [\d.]+ [kM]B of [\d.]+ MB.*Preparing the light/s);
  await page.close();
});

it("runs under the policy that the documentation gives", async () => {
  const recipe = /^Content-Security-Policy: ([^`]+)```/m.exec(readFileSync(new URL("../../docs/web.md", import.meta.url), "utf8"))![1]!;
  const script = /<script type="module"[^>]*>(.*?)<\/script>/s.exec(html)![1]!;
  const hashes = [createHash("sha256").update(script).digest("base64"), /data-sha256="(.{44})"/.exec(html)![1]!];
  const policyOf = (named: readonly string[]) => {
    const left = named.map((hash) => `'sha256-${hash}'`);
    return recipe.replace(/\s+/g, " ").trim().replace(/'sha256-…'/g, () => left.shift() ?? "");
  };
  const openUnder = (policy: string) => open(site.put("/strict.html", html, { "content-security-policy": policy }));
  const forbidden = /policy of this page forbids the script of the lens/;
  // The lens says so where its hash is missing; all else works.
  const { page, errors } = await openUnder(policyOf(hashes.slice(0, 1)));
  expect(errors).toEqual([]);
  await page.evaluate(() => window.lightwell.setLens(true));
  expect(await page.locator("body").innerText()).toMatch(forbidden);
  await openUnder(policyOf(hashes));
  await page.evaluate(() => window.lightwell.setLens(true));
  expect(await page.locator("body").innerText()).not.toMatch(forbidden);
  expect(errors).toEqual([]);
  // It does forbid: another script does not run.
  await page.evaluate(() => {
    const other = document.createElement("script");
    other.textContent = "window.foreign = true";
    document.body.append(other);
  });
  expect(await page.evaluate(() => "foreign" in window)).toBe(false);
  expect(errors.join()).toMatch(/Content Security Policy/);
});
