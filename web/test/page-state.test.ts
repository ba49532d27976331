/** What is shown, in the page's address and for the page around a frame; flying by keys. */

import { readFileSync } from "node:fs";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect, it } from "vitest";
import { readOptions } from "../viewer/src/options.ts";
import { COARSE, launch, openPage, Site } from "./support/browser.ts";
import { CAMERA, linearField, plainRoom, stillField } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";
import { packReference, pageWith } from "./support/page.ts";

let browser: Browser;
let page: Page;
let errors: string[];
let address = "";
const site = new Site();

beforeAll(async () => {
  await site.open();
  browser = await launch("llvmpipe");
  address = site.put("/page.html", pageWith(writeGlb(plainRoom({ fields: [linearField(), stillField()] })), { home: CAMERA }));
  site.put("/around.html", `<!doctype html><link rel="icon" href="data:,"><iframe src="/page.html?mode=learned&exposure=1" width="320" height="240"></iframe>`);
  ({ page, errors } = await openPage(browser, 640, 480, COARSE));
  await page.context().grantPermissions(["clipboard-read", "clipboard-write"]);
  await page.goto(`${address}?tonemap=none&exposure=1&dither=0`);
  await page.evaluate(() => window.lightwell.ready);
}, 90_000);

afterAll(async () => {
  await browser?.close();
  await site.close();
  expect(errors).toEqual([]);
});

const link = () => page.evaluate(() => window.lightwell.link());
const cameraOf = (text: string) => readOptions(new URL(text).search).camera!;

it("the lamp's handle is above the line of the split", async () => {
  await page.evaluate(() => {
    window.lightwell.setCamera([0, 1, 4.2], [0, 1, 0], 36);
    window.lightwell.setLight([0, 1, 0]);
    window.lightwell.setSplit(0.5);
    return window.lightwell.setMode("split");
  });
  await page.waitForFunction(() => document.querySelector(".lamp")!.getBoundingClientRect().left > 0);
  const at = await page.evaluate(() => {
    const [lamp, line] = [".lamp", ".split"].map((name) => document.querySelector(name)!.getBoundingClientRect());
    const [x, y] = [(lamp!.left + lamp!.right) / 2, (lamp!.top + lamp!.bottom) / 2];
    return { apart: Math.abs(x - (line!.left + line!.right) / 2), name: document.elementFromPoint(x, y)!.className };
  });
  expect(at.apart).toBeLessThan(2);
  expect(at.name).toMatch(/^lamp/);
});

it("the copied link shows the same: camera, lamps, mode, split, exposure", async () => {
  await page.evaluate(async () => {
    const { lightwell } = window;
    await lightwell.setMode("split");
    lightwell.setSplit(0.3);
    lightwell.setCamera([0.5, 1.2, 3.5], [0.1, 0.9, -0.2], 40);
    await lightwell.addLamp();
    lightwell.setLight([0.4, 1.3, 0.2]);
    lightwell.setLight([-0.5, 0.6, 0.1], 1);
    lightwell.setIntensity(2.5, 1);
    lightwell.setColor([0.2, 0.4, 0.8], 1);
  });
  await page.getByRole("button", { name: "Copy link" }).click({ timeout: 10_000 });
  await expect.poll(() => page.evaluate(() => window.lightwell.stats().notice)).toMatch(/copied/);
  const copied = await page.evaluate(() => navigator.clipboard.readText());
  expect(copied).toBe(await link());
  const asked = readOptions(new URL(copied).search);
  expect(asked).toMatchObject({ mode: "split", split: 0.3, against: "direct", camera: [0.5, 1.2, 3.5, 0.1, 0.9, -0.2, 40], exposure: 1, toneMapping: "none", dither: false });
  expect(asked.lights.map(({ value, intensity }) => [value, intensity])).toEqual([[[0.4, 1.3, 0.2], 4], [[-0.5, 0.6, 0.1], 2.5]]);
  const pixels = () => page.evaluate(() => Array.from(window.lightwell.readPixels().data).filter((_, i) => i % 64 < 3));
  const before = await pixels();
  await page.goto(copied);
  await page.evaluate(() => window.lightwell.ready);
  expect(await link()).toBe(copied);
  const after = await pixels();
  const wrong = before.filter((x, i) => Math.abs(x - after[i]!) > 2).length;
  expect(wrong / before.length).toBeLessThan(1e-3);
  expect(new Set(before).size).toBeGreaterThan(50);
});

it("arrows fly when nothing else takes them, and end at once", async () => {
  await page.evaluate(() => {
    window.lightwell.setCamera([0, 1, 4], [0, 1, 0], 40);
    (document.activeElement as HTMLElement | null)?.blur();
  });
  const frame = () => page.evaluate(() => new Promise<void>((done) => requestAnimationFrame(() => requestAnimationFrame(() => done()))));
  const camera = async () => cameraOf(await link());
  /**
   * How far the camera went by a key held for 150 ms of motion, or for 300 ms where it must rest. The page itself
   * lets go: on a busy machine the camera could turn half around before the test hears that it has moved.
   */
  const held = async (key: string, moves = true) => {
    const before = await camera();
    const released = page.evaluate(
      async ([name, wait]) => {
        const first = window.lightwell.link();
        let began = 0;
        while (wait && (began === 0 || performance.now() - began < 150)) {
          await new Promise((done) => requestAnimationFrame(done));
          if (began === 0 && window.lightwell.link() !== first) began = performance.now();
        }
        if (wait) document.body.dispatchEvent(new KeyboardEvent("keyup", { key: name, bubbles: true }));
      },
      [key, moves] as const,
    );
    await page.keyboard.down(key);
    await released;
    if (!moves) await page.waitForTimeout(300);
    await page.keyboard.up(key);
    await frame();
    return (await camera()).map((x, i) => x - before[i]!);
  };
  const ahead = await held("ArrowUp");
  expect(ahead[2]).toBeLessThan(-0.02);
  expect(ahead[5]).toBeCloseTo(ahead[2]!, 3);
  const turned = await held("ArrowLeft");
  for (const x of turned.slice(0, 3)) expect(x).toBeCloseTo(0, 6);
  expect(turned[3]).toBeLessThan(-0.02);
  expect((await held("PageUp"))[1]).toBeGreaterThan(0.02);
  // macOS does not tell that an arrow is let go while the command key is down.
  await page.evaluate(() => {
    for (const key of ["ArrowUp", "Meta"]) document.body.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
  });
  await frame();
  const resting = await camera();
  await page.waitForTimeout(200);
  await frame();
  expect(await camera()).toEqual(resting);
  await page.getByRole("slider", { name: "Border between the left and the learned picture" }).focus();
  for (const x of await held("ArrowLeft", false)) expect(x).toBeCloseTo(0, 6);
});

it("the page around a frame asks and says what is shown; others are not heard", async () => {
  await page.goto(address.replace("page.html", "around.html"));
  const ask = (request: object) =>
    page.evaluate(
      (data) =>
        new Promise<Record<string, unknown>>((resolve) => {
          const listen = (event: MessageEvent) => {
            if (event.data.id !== data.id) return;
            removeEventListener("message", listen);
            resolve(event.data);
          };
          addEventListener("message", listen);
          document.querySelector("iframe")!.contentWindow!.postMessage(data, "*");
        }),
      request as { id: number },
    );
  await expect.poll(() => page.frames()[1]?.evaluate(() => window.lightwell?.ready.then(() => true)), { timeout: 30_000 }).toBe(true);
  const { state } = await ask({ lightwell: "set", id: 1, state: { mode: "indirect", camera: "0,1,3,0,1,0,50", lights: "0.3,1,0.2" } });
  expect(state).toMatchObject({ mode: "indirect", camera: "0,1,3,0,1,0,50", exposure: "1" });
  expect((state as { lights: string }).lights).toMatch(/^0\.3,1,0\.2,/);
  expect(await ask({ lightwell: "get", id: 2 })).toMatchObject({ lightwell: "state", id: 2, state: { mode: "indirect" } });
  for (const [id, wrong] of [[3, { camera: 5 }], [4, { src: "x" }], [5, null]] as const)
    expect(await ask({ lightwell: "set", id, state: wrong })).toMatchObject({ lightwell: "error", message: expect.stringMatching(/^state/) });
  // A message that the frame sends to itself is not from the page around it.
  await page.frames()[1]!.evaluate(() => window.postMessage({ lightwell: "set", state: { mode: "direct" } }, "*"));
  expect(await ask({ lightwell: "get", id: 6 })).toMatchObject({ state: { mode: "indirect" } });
});

it("what moves comes back after a reference, goes home, and does not leave a saved view", async () => {
  const door = readFileSync(new URL("fixtures/field-and-probes.glb", import.meta.url));
  const reference = { width: 4, height: 3, ...packReference(new Float32Array(36).fill(0.1), 4) };
  const views = [{ name: "ajar", camera: { position: [0, 1, 3], target: [0, 1, 0] }, pose: [0.1234567], ...reference }];
  await page.goto(`${site.put("/door.html", pageWith(door, { home: CAMERA, views }))}?mode=learned&movers=Door:30`);
  await page.evaluate(() => window.lightwell.ready);
  const moved = async () => new URL(await link()).searchParams.get("movers");
  const modes = async (mode: "reference" | "learned") => (await page.evaluate((name) => window.lightwell.setMode(name), mode), moved());
  expect([await moved(), await modes("reference"), await modes("learned")]).toEqual(["Door:30", "Door:11.111", "Door:30"]);
  await page.locator('[aria-label="Start again"]').dispatchEvent("click");
  expect(await moved()).toBeNull();
  await page.evaluate(() => window.lightwell.setView(0));
  await page.goto(await link());
  await page.evaluate(() => window.lightwell.ready);
  expect([await moved(), await page.evaluate(() => window.lightwell.stats().view)]).toEqual(["Door:11.111", 0]);
});
