/** The lens in the viewer: the scene is drawn, blurred and shown on one WebGPU device, with the tone curve of the sharp picture. */

import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, beforeEach, expect, it } from "vitest";
import { launch, openPage, Site } from "./support/browser.ts";
import { furnishedRoom } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";
import { pageWith } from "./support/page.ts";

const [WIDTH, HEIGHT] = [160, 120];
const site = new Site();
let browser: Browser | undefined;
let page: Page;
let errors: string[] = [];
let adapter = false;

beforeAll(async () => {
  await site.open();
  browser = await launch("swiftshader");
  ({ page, errors } = await openPage(browser, WIDTH, HEIGHT));
  await page.addInitScript(() => {
    // A device that goes when the test says so: browsers have no other way.
    const own = globalThis.GPUAdapter?.prototype.requestDevice;
    if (!own) return;
    GPUAdapter.prototype.requestDevice = async function (descriptor) {
      const device = await own.call(this, descriptor);
      const lost = new Promise<GPUDeviceLostInfo>((resolve) => Object.assign(window, { loseDevice: resolve }));
      Object.defineProperty(device, "lost", { value: lost });
      return device;
    };
    // What is read back, bytes.
    Object.assign(window, { readBack: 0 });
    const map = GPUBuffer.prototype.mapAsync;
    GPUBuffer.prototype.mapAsync = function (mode, ...range) {
      if (mode === GPUMapMode.READ) (window as any).readBack += this.size;
      return map.call(this, mode, ...range);
    };
    const read = WebGL2RenderingContext.prototype.readPixels;
    WebGL2RenderingContext.prototype.readPixels = function (this: WebGL2RenderingContext, ...given: any[]) {
      (window as any).readBack += given[2] * given[3] * 4;
      return (read as any).apply(this, given);
    };
  });
  await page.goto(site.put("/index.html", pageWith(writeGlb(furnishedRoom()))).concat(`?size=${WIDTH}x${HEIGHT}&ui=0&dither=0`));
  await page.evaluate(() => window.lightwell.ready);
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

/** What is on the screen: grey values, and the mean difference of neighbours along rows. */
async function shown(): Promise<{ grey: number[]; contrast: number }> {
  const png = (await page.screenshot()).toString("base64");
  return page.evaluate(async (bytes) => {
    const image = await createImageBitmap(new Blob([Uint8Array.from(atob(bytes), (c) => c.charCodeAt(0))]));
    const context = new OffscreenCanvas(image.width, image.height).getContext("2d")!;
    context.drawImage(image, 0, 0);
    const { data } = context.getImageData(0, 0, image.width, image.height);
    const grey = Array.from({ length: data.length / 4 }, (_, i) => (data[4 * i]! + data[4 * i + 1]! + data[4 * i + 2]!) / 3);
    const steps = grey.map((v, i) => ((i + 1) % image.width ? Math.abs(v - grey[i + 1]!) : 0));
    return { grey, contrast: steps.reduce((a, v) => a + v, 0) / steps.length };
  }, png);
}

const set = (on: boolean, setting: { focus?: number; fstop?: number }) => page.evaluate(([o, s]) => window.lightwell.setLens(o as boolean, s as object), [on, setting] as const);
const difference = (a: number[], b: number[]) => a.reduce((n, v, i) => n + Math.abs(v - b[i]!), 0) / a.length;

it("softens what is out of focus, keeps the light, and goes when it is switched off", async () => {
  const sharp = await shown();
  await set(true, { focus: 0.5, fstop: 0.3 });
  const soft = await shown();
  expect(soft.contrast).toBeLessThan(0.75 * sharp.contrast);
  const mean = ({ grey }: { grey: number[] }) => grey.reduce((a, v) => a + v, 0) / grey.length;
  expect(Math.abs(mean(soft) / mean(sharp) - 1)).toBeLessThan(0.05);
  await set(true, { fstop: 22 });
  expect(difference((await shown()).grey, sharp.grey)).toBeLessThan(1.5);
  await set(false, {});
  await page.evaluate(() => window.lightwell.renderOnce());
  expect(difference((await shown()).grey, sharp.grey)).toBeLessThan(0.5);
});

it("reads no pixels back, and follows lamps and modes", async () => {
  const same = async () => {
    expect(await page.locator("canvas.lens").isVisible()).toBe(true);
    const soft = (await shown()).grey;
    await page.evaluate(() => window.lightwell.setLens(false));
    await page.evaluate(() => window.lightwell.renderOnce());
    return difference(soft, (await shown()).grey);
  };
  await page.evaluate(() => ((window as any).readBack = 0));
  await set(true, { fstop: 22 });
  // A flag a frame says whether anything is uncovered.
  expect(await page.evaluate(() => (window as any).readBack)).toBeLessThanOrEqual(4 * 4);
  const before = (await shown()).grey;
  await page.evaluate(() => {
    window.lightwell.setLight([0.5, 1.6, 0.5]);
    window.lightwell.setColor([1, 0.5, 0.2]);
  });
  await set(true, {});
  expect(difference((await shown()).grey, before)).toBeGreaterThan(2);
  expect(await same()).toBeLessThan(1.5);
  for (const mode of ["direct", "indirect"] as const) {
    await page.evaluate((name) => window.lightwell.setMode(name), mode);
    await set(true, {});
    expect(await same()).toBeLessThan(1.5);
  }
  await page.evaluate(() => window.lightwell.setMode("learned"));
  await page.evaluate(() => window.lightwell.addLamp());
  await set(true, {});
  expect(await same()).toBeLessThan(1.5);
});

it.each(process.env.LIGHTWELL_LONG_TESTS ? [""] : [])("pictures are those through the lens, in split mode too", async () => {
  const contrast = () =>
    page.evaluate(() => {
      const { data, width } = window.lightwell.readPixels();
      let sum = 0;
      for (let i = 0; i < data.length; i += 4) if ((i / 4 + 1) % width) sum += Math.abs(data[i]! - data[i + 4]!);
      return (4 * sum) / data.length;
    });
  const sharp = await contrast();
  await set(true, { focus: 0.5, fstop: 0.3 });
  expect(await contrast()).toBeLessThan(0.75 * sharp);
  const blob = await page.evaluate(async () => (await window.lightwell.takePicture()).size);
  expect(blob).toBeGreaterThan(500);
  // To the left the picture of direct light, to the right the learned one.
  const inMode = async (mode: "learned" | "direct" | "split") => {
    await page.evaluate((name) => window.lightwell.setMode(name), mode);
    await set(true, { fstop: 4 });
    return (await shown()).grey;
  };
  const [learned, direct, split] = [await inMode("learned"), await inMode("direct"), await inMode("split")];
  const half = (grey: number[], left: boolean) => grey.filter((_, i) => i % WIDTH < WIDTH / 2 === left);
  expect(difference(half(split, true), half(direct, true))).toBeLessThan(0.5);
  expect(difference(half(split, false), half(learned, false))).toBeLessThan(0.5);
  expect(difference(learned, direct)).toBeGreaterThan(1);
  await page.evaluate(() => window.lightwell.setMode("learned"));
  await set(false, {});
});

it("says that the device was lost, and shows sharp pictures", async () => {
  await set(true, { focus: 0.5, fstop: 0.3 });
  await page.evaluate(() => (window as any).loseDevice({ reason: "unknown", message: "the driver was restarted" }));
  await expect.poll(() => page.evaluate(() => window.lightwell.stats().notice)).toBe("The lens lost its graphics device and is off: the driver was restarted. Switch it on again to try once more.");
  const sharp = await shown();
  expect(sharp.contrast).toBeGreaterThan(1);
  // Another device must compile the lens anew.
  if (!process.env.LIGHTWELL_LONG_TESTS) return;
  await set(true, { focus: 0.5, fstop: 0.3 });
  expect((await shown()).contrast).toBeLessThan(0.75 * sharp.contrast);
});
