/** The controls around the picture. */

import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { pathToFileURL } from "node:url";
import type { Browser, Page } from "playwright-core";
import { afterAll, afterEach, beforeAll, expect, it } from "vitest";
import { COARSE, launch, openPage, Site } from "./support/browser.ts";
import { expertField } from "./support/experts.ts";
import { CAMERA, furnishedRoom, linearField, plainRoom, stillField } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";
import { BUILT_PAGE, packReference, pageWith } from "./support/page.ts";

let browser: Browser;
let tab: { page: Page; errors: string[] };
const site = new Site();
const folder = mkdtempSync(join(tmpdir(), "lightwell-"));

beforeAll(async () => {
  browser = await launch("llvmpipe");
  await site.open();
  tab = await openPage(browser, 640, 480, COARSE);
});

afterAll(async () => {
  await browser?.close();
  await site.close();
  rmSync(folder, { recursive: true });
});

afterEach(() => {
  expect(tab.errors.splice(0)).toEqual([]);
});

async function open(width: number, height: number, html: string, mode = "learned"): Promise<Page> {
  const { page } = tab;
  await page.setViewportSize({ width, height });
  await page.goto(`${site.put("/page.html", html)}?mode=${mode}`);
  await page.evaluate(() => window.lightwell.ready);
  return page;
}

const grey = packReference(new Float32Array(16 * 12 * 3).fill(0.2), 16);
const view = { camera: CAMERA, light: [0.2, 1, 0.2], width: 16, height: 12, ...grey };
const views = [
  { ...view, name: "Lamp right" },
  { ...view, name: "</script><b>Lamp left", light: [-0.2, 1, 0.2] },
];
const data = {
  title: "Two <i>fields",
  home: CAMERA,
  views,
  report: { relative_error: 0.042, psnr_db: 36.5 },
};
const html = () => pageWith(writeGlb(furnishedRoom({ fields: [linearField(), stillField()] })), data);
const stats = (page: Page) => page.evaluate(() => window.lightwell.stats());

/** The furnished room with two views as it is when the page opens: it is loaded once, and put back for the next test. */
async function openRoom(width: number, height: number): Promise<Page> {
  const { page } = tab;
  if (!page.url().includes("/page.html") || (await stats(page)).title !== data.title) return open(width, height, html());
  await page.setViewportSize({ width, height });
  await page.evaluate(async () => {
    const { lightwell } = window;
    while (lightwell.stats().lights.length > 1) lightwell.removeLamp(1);
    await lightwell.setMode("learned");
  });
  await page.locator('[aria-label="Start again"]').dispatchEvent("click");
  await expect.poll(() => stats(page)).toMatchObject({ mode: "learned", view: null, preparing: false, lights: [[0, 1.6, 0]] });
  return page;
}

it("switches modes by keys and by the control", async () => {
  const page = await openRoom(640, 480);
  for (const [key, mode] of [
    ["2", "reference"],
    ["3", "difference"],
    ["4", "direct"],
    ["5", "indirect"],
    ["6", "split"],
    ["1", "learned"],
  ]) {
    await page.keyboard.press(key!);
    expect((await stats(page)).mode).toBe(mode);
    expect(await page.locator(".modes [aria-checked=true]").innerText()).toBe(
      mode![0]!.toUpperCase() + mode!.slice(1),
    );
  }
  await page.getByRole("radio", { name: "Difference" }).click();
  await page.locator(".legend").waitFor();
  expect((await stats(page)).view).not.toBeNull();
});

it("writes names as text, and numbers as people read them", async () => {
  // Whether the panel is open is decided where the page opens.
  const page = await open(900, 640, html());
  expect(await page.locator("header h1").innerText()).toBe("Two <i>fields");
  expect(await page.locator(".view span").nth(1).innerText()).toBe("</script><b>Lamp left");
  const numbers = await page.locator(".numbers").innerText();
  expect(numbers).toContain("4.2 %");
  expect(numbers).toContain("36.5 dB");
  expect(numbers).toContain("18 / px");
});

it("can be used while the learned light is compiled", async () => {
  const { page, errors } = await openPage(browser, 640, 480, COARSE);
  // The programs of the field are not ready until `release` is set.
  await page.addInitScript(() => {
    const COMPLETION_STATUS = 0x91b1;
    const gl = WebGL2RenderingContext.prototype;
    const { shaderSource, attachShader, getProgramParameter, linkProgram } = gl;
    const [shaders, programs] = [new WeakSet<WebGLShader>(), new WeakSet<WebGLProgram>()];
    Object.assign(window, { release: false, links: 0 });
    gl.shaderSource = function (shader, source) {
      if (source.includes("lightwellField0")) shaders.add(shader);
      shaderSource.call(this, shader, source);
    };
    gl.attachShader = function (program, shader) {
      if (shaders.has(shader)) programs.add(program);
      attachShader.call(this, program, shader);
    };
    gl.linkProgram = function (program) {
      if (programs.has(program)) (window as unknown as { links: number }).links++;
      linkProgram.call(this, program);
    };
    gl.getProgramParameter = function (program, name) {
      const waits = programs.has(program) && !(window as unknown as { release: boolean }).release;
      return name === COMPLETION_STATUS && waits ? false : getProgramParameter.call(this, program, name);
    };
  });
  await page.goto(site.put("/compiled.html", html()));
  await page.locator(".preparing").waitFor();
  expect(await page.locator(".preparing").innerText()).toContain("Preparing the learned light");
  await page.locator(".view").nth(1).click();
  await expect.poll(async () => (await stats(page)).view).toBe(1);
  const links = () => page.evaluate(() => (window as unknown as { links: number }).links);
  await expect.poll(links).toBeGreaterThan(0);
  const begun = await links();
  const sum = () =>
    page.evaluate(() => window.lightwell.readRadiance().data.reduce((total, value) => total + value, 0));
  const direct = await sum();
  expect(direct).toBeGreaterThan(0);
  expect(await stats(page)).toMatchObject({ preparing: true, comparison: null });
  await page.evaluate(() => Object.assign(window, { release: true }));
  await page.evaluate(() => window.lightwell.ready);
  expect(await sum()).toBeGreaterThan(1.01 * direct);
  expect(await stats(page)).toMatchObject({ preparing: false, view: 1, weights: "inline" });
  await page.locator(".preparing").waitFor({ state: "hidden" });
  // What was compiled ahead is what is drawn with.
  expect(await links()).toBe(begun);
  expect(errors).toEqual([]);
  await page.close();
});

it("stops down for a view that would be washed out, and back", async () => {
  const bright = packReference(new Float32Array(16 * 12 * 3).fill(9), 16);
  const page = await open(
    320,
    240,
    pageWith(writeGlb(plainRoom()), {
      home: CAMERA,
      exposure: 1,
      views: [
        { ...view, name: "a" },
        { ...view, name: "b", ...bright },
      ],
    }),
  );
  await page.evaluate(() => window.lightwell.setView(1));
  expect((await stats(page)).exposure).toBeCloseTo(0.05, 3);
  await page.evaluate(() => window.lightwell.setView(0));
  expect((await stats(page)).exposure).toBe(1);
});

it("shows a lamp that is out of sight at the rim", async () => {
  const page = await openRoom(640, 480);
  await page.evaluate(() => window.lightwell.setCamera([0, 0.3, 3], [0, -0.6, 0]));
  await page.locator(".lamp.away").waitFor();
  const box = (await page.locator(".lamp").boundingBox())!;
  expect(box.y).toBeGreaterThanOrEqual(0);
  expect(box.y + box.height).toBeLessThanOrEqual(480);
});

it("goes to a saved view, and home", async () => {
  const page = await openRoom(640, 480);
  await page.locator(".view").nth(1).click();
  expect(await stats(page)).toMatchObject({ view: 1, lights: [[-0.2, 1, 0.2]] });
  await page.getByRole("button", { name: "Start again" }).click();
  expect(await stats(page)).toMatchObject({ view: null, lights: [[0, 1.6, 0]] });
});

it("moves the light by pointer, wheel and keys, and says when it stops it", async () => {
  const page = await openRoom(740, 480);
  const box = (await page.locator(".lamp").boundingBox())!;
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 40, y + 60);
  await page.mouse.up();
  const [moved] = (await stats(page)).lights;
  expect(moved![0]).toBeGreaterThan(0.1);
  expect(moved![1]).toBeLessThan(1.5);
  expect(moved![2]).toBeCloseTo(0, 5);
  expect(await page.locator(".place").textContent()).toContain(moved![0]!.toFixed(2));
  await page.mouse.move(x + 40, y + 60);
  await page.mouse.wheel(0, 100);
  await expect.poll(async () => (await stats(page)).lights[0]![2]).toBeGreaterThan(0.01);
  await page.locator(".lamp").focus();
  await page.keyboard.press("ArrowLeft");
  expect((await stats(page)).lights[0]![0]).toBeLessThan(moved![0]!);
  for (let i = 0; i < 40; i++) await page.keyboard.press("ArrowUp");
  expect((await stats(page)).lights[0]![1]).toBe(1.8);
  expect(await page.locator(".notice.shown").innerText()).toContain("stays inside");
});

it("on a phone, a finger drags the lamp, the panel opens and folds, and the help begins with gestures", async () => {
  const context = await browser.newContext({ viewport: { width: 390, height: 780 }, deviceScaleFactor: COARSE, hasTouch: true, isMobile: true });
  const page = await context.newPage();
  await page.goto(`${site.put("/phone.html", html())}?mode=learned`);
  await page.evaluate(() => window.lightwell.ready);
  const box = (await page.locator(".lamp").boundingBox())!;
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  const fingers = await context.newCDPSession(page);
  const touch = (type: "touchStart" | "touchMove" | "touchEnd", touchPoints: { x: number; y: number }[]) => fingers.send("Input.dispatchTouchEvent", { type, touchPoints });
  await touch("touchStart", [{ x, y }]);
  await touch("touchMove", [{ x: x + 15, y: y + 20 }]);
  await touch("touchMove", [{ x: x + 30, y: y + 40 }]);
  await touch("touchEnd", []);
  const [moved] = (await stats(page)).lights;
  expect(moved![0]).toBeGreaterThan(0.1);
  expect(moved![1]).toBeLessThan(1.5);
  // The picture stood still meanwhile.
  expect((await stats(page)).mode).toBe("learned");
  const [panel, exposure] = [page.getByRole("button", { name: "Controls" }), page.getByRole("slider", { name: "Exposure" })];
  expect(await exposure.isVisible()).toBe(false);
  // A page that is busy with the last frames of the drag may lose a tap.
  const opened = async () => {
    await panel.tap();
    return exposure.waitFor({ timeout: 5_000 }).then(() => true, () => false);
  };
  await expect.poll(opened, { timeout: 30_000 }).toBe(true);
  await page.getByRole("button", { name: "Help" }).tap();
  expect(await page.getByRole("dialog").locator("dt").first().innerText()).toContain("one finger");
  await page.getByRole("button", { name: "Close" }).tap();
  await panel.tap();
  await exposure.waitFor({ state: "hidden" });
  await context.close();
});

it("orbits, and then a reference no longer applies", async () => {
  const page = await openRoom(640, 480);
  await page.keyboard.press("2");
  await page.mouse.move(60, 200);
  await page.mouse.down();
  await page.mouse.move(120, 220, { steps: 3 });
  await page.mouse.up();
  await expect.poll(async () => (await stats(page)).mode).toBe("learned");
});

it("draws nothing while nothing changes", async () => {
  const page = await openRoom(320, 240);
  await page.waitForTimeout(700);
  await page.waitForFunction(() => window.lightwell.rests());
  const drawn = await page.evaluate(async () => {
    let count = 0;
    const { drawArrays, drawElements } = WebGL2RenderingContext.prototype;
    WebGL2RenderingContext.prototype.drawElements = function (...a) {
      count++;
      drawElements.apply(this, a);
    };
    WebGL2RenderingContext.prototype.drawArrays = function (...a) {
      count++;
      drawArrays.apply(this, a);
    };
    await new Promise((resolve) => setTimeout(resolve, 400));
    return count;
  });
  expect(drawn).toBe(0);
});

it.each(process.env.LIGHTWELL_LONG_TESTS ? [""] : [])("smooths edges once nothing changes, and a change ends it", async () => {
  const large = await (await open(384, 288, html(), "learned&size=384x288")).evaluate(() => Array.from(window.lightwell.readPixels().data));
  const page = await open(384, 288, html(), "learned&size=96x72");
  // Mean distances from a picture of 16 samples a pixel, of the canvas drawn once, and with smooth edges.
  const found = await page.evaluate((large) => {
    const { lightwell } = window;
    const canvas = document.querySelector("canvas")!;
    const drawn = (draw: () => void) => {
      draw();
      const context = new OffscreenCanvas(96, 72).getContext("2d")!;
      context.drawImage(canvas, 0, 0);
      return context.getImageData(0, 0, 96, 72).data;
    };
    const once = drawn(() => lightwell.renderOnce());
    const smooth = drawn(() => lightwell.renderSmooth());
    const again = drawn(() => lightwell.renderOnce());
    const distance = (data: Uint8ClampedArray) => {
      let sum = 0;
      for (let i = 0; i < data.length; i++) {
        const [x, y, c] = [(i >> 2) % 96, Math.floor((i >> 2) / 96), i & 3];
        let mean = 0;
        for (let k = 0; k < 16; k++) mean += large[4 * ((4 * y + (k >> 2)) * 384 + 4 * x + (k & 3)) + c]! / 16;
        sum += Math.abs(data[i]! - mean);
      }
      return sum / data.length;
    };
    return { once: distance(once), smooth: distance(smooth), same: once.every((x, i) => x === again[i]) };
  }, large);
  expect(found.smooth).toBeLessThan(0.9 * found.once);
  expect(found.same).toBe(true);
  await page.evaluate(() => window.lightwell.setIntensity(0.5));
  expect(await page.evaluate(() => window.lightwell.rests())).toBe(false);
  await page.waitForFunction(() => window.lightwell.rests());
  // A reference is smooth by itself.
  await page.evaluate(() => window.lightwell.setView(0));
  const frames = await page.evaluate(async () => {
    window.lightwell.setMode("reference");
    let count = 0;
    for (; !window.lightwell.rests(); count++) await new Promise(requestAnimationFrame);
    return count;
  });
  expect(frames).toBeLessThan(12); // Smooth edges take 23 frames.
});

it("fits a phone: no control leaves the screen, and open controls leave the picture in sight", async () => {
  const page = await openRoom(390, 844);
  for (const selector of [".modes", ".views", ".panel", "header"]) {
    const box = (await page.locator(selector).boundingBox())!;
    expect(box.x).toBeGreaterThanOrEqual(0);
    expect(box.x + box.width).toBeLessThanOrEqual(390);
    expect(box.y + box.height).toBeLessThanOrEqual(844);
  }
  await page.getByRole("button", { name: "Controls" }).click();
  await page.getByRole("slider", { name: "Exposure" }).waitFor();
  // What a control changes stays in sight: the upper half of the picture is free.
  const open = (await page.locator(".panel-body").boundingBox())!;
  expect(open.y).toBeGreaterThan(844 / 2);
  expect(open.y + open.height).toBeLessThanOrEqual(844);
});

it("moves a sun along its arc by a slider", async () => {
  const sun = {
    name: "sun",
    kind: "sun",
    start: [1, 0.2, 0],
    middle: [0, 1, 0.3],
    end: [-1, 0.2, 0],
    intensity: 2,
  };
  const glb = writeGlb(furnishedRoom({ variables: [sun] }));
  const page = await open(900, 640, pageWith(glb, { title: "Sun", home: CAMERA }));
  const slider = page.getByRole("slider", { name: "Path" });
  expect(Number(await slider.inputValue())).toBeCloseTo(0.5, 2);
  await slider.fill("1");
  const [direction] = (await stats(page)).lights;
  expect(direction![0]).toBeCloseTo(-1 / Math.hypot(1, 0.2), 5);
  expect(await page.locator(".lamp").count()).toBe(0);
  await page.keyboard.press("+");
  expect((await stats(page)).lights).toHaveLength(2);
  expect(await page.getByRole("slider", { name: "Path" }).count()).toBe(2);
  await expect.poll(async () => (await stats(page)).preparing).toBe(false);
});

it("adds and removes lamps by keys and by the panel, and halves the resolution", async () => {
  const page = await openRoom(900, 900);
  const lights = async () => (await stats(page)).lights.length;
  await page.keyboard.press("+");
  expect(await lights()).toBe(2);
  await page.getByRole("button", { name: "Add a lamp" }).click();
  expect(await lights()).toBe(3);
  expect(await page.locator(".lamp").count()).toBe(3);
  expect(await page.locator(".lights h2").allInnerTexts()).toEqual([
    "Light 1",
    expect.stringMatching(/^Light 2\s*Remove$/),
    expect.stringMatching(/^Light 3\s*Remove$/),
  ]);
  // The farthest of all places is taken.
  const [[x, , z]] = (await stats(page)).lights.slice(1) as [number[]];
  expect(Math.hypot(x!, z!)).toBeGreaterThan(0.5);
  await page.getByRole("button", { name: "Remove" }).first().click();
  await page.keyboard.press("-");
  await page.keyboard.press("-");
  expect(await lights()).toBe(1);
  expect(await page.getByRole("button", { name: "Remove" }).count()).toBe(0);
  await page.keyboard.press("r");
  expect((await stats(page)).half).toBe(true);
  await page.getByRole("switch", { name: "Half resolution" }).click();
  expect((await stats(page)).half).toBe(false);
  // A saved view is the light of the bake.
  await page.keyboard.press("+");
  await page.locator(".view").nth(1).click();
  await expect.poll(() => stats(page)).toMatchObject({ view: 1, lights: [[-0.2, 1, 0.2]], preparing: false });
});

it("offers experts where a field has them", async () => {
  const page = await openRoom(900, 640);
  expect(await page.getByRole("radio", { name: "Experts" }).isVisible()).toBe(false);
  await page.keyboard.press("7");
  expect(await stats(page)).toMatchObject({ mode: "learned", notice: expect.stringContaining("no parts") });
  const other = await open(900, 640, pageWith(writeGlb(plainRoom({ fields: [expertField()] })), data));
  await other.getByRole("radio", { name: "Experts" }).click();
  expect((await stats(other)).mode).toBe("experts");
  expect(await other.locator(".palette").innerText()).toContain("stripes: two share");
  expect(await other.locator(".lamp").isVisible()).toBe(false);
  await other.keyboard.press("2");
  await expect.poll(() => stats(other)).toMatchObject({ mode: "reference", preparing: false });
  // The figures of a reference come with its first picture.
  await expect.poll(async () => (await stats(other)).comparison).not.toBeNull();
});

it("opens a chosen file when it carries none", async () => {
  const page = await open(480, 360, readFileSync(BUILT_PAGE, "utf8"));
  const file = {
    name: "my room.glb",
    mimeType: "model/gltf-binary",
    buffer: Buffer.from(writeGlb(plainRoom())),
  };
  tab.errors.length = 0; // scene.glb beside the page: not there
  await page.locator("input[type=file]").setInputFiles(file);
  await expect.poll(async () => (await stats(page)).title).toBe("my room");
});

it("loads the asset that its address names", async () => {
  site.put("/there.glb", writeGlb(plainRoom()));
  await tab.page.goto(`${site.put("/empty.html", readFileSync(BUILT_PAGE, "utf8"))}?asset=there.glb`);
  await tab.page.evaluate(() => window.lightwell.ready);
  expect((await stats(tab.page)).title).toBe("there");
});

it("opens from a file", async () => {
  const path = join(folder, "index.html");
  writeFileSync(path, html());
  await tab.page.goto(pathToFileURL(path).href);
  await tab.page.evaluate(() => window.lightwell.ready);
  expect((await stats(tab.page)).fields).toHaveLength(2);
});
