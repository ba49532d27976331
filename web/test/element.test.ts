/** `<lightwell-viewer>`: what its attributes do, what it tells, and one renderer for all elements of a page. */

import { readFileSync } from "node:fs";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect, it } from "vitest";
import { launch, openPage, Site } from "./support/browser.ts";
import { bundle, modulePage } from "./support/bundle.ts";
import { plainRoom, stillField } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";

/** Counts contexts that draw, and defines the element. */
const ENTRY = `
const own = HTMLCanvasElement.prototype.getContext;
window.contexts = 0;
HTMLCanvasElement.prototype.getContext = function (kind, options) {
  if (kind === "webgl2") window.contexts++;
  return own.call(this, kind, options);
};
import("lightwell/element");`;

/** A room with two cameras: in front, and from above. */
const room = plainRoom({
  tamper: (json: any) => {
    const perspective = { yfov: 0.6, znear: 0.1 };
    json.cameras = [{ type: "perspective", perspective, name: "front" }, { type: "perspective", perspective, name: "near" }];
    json.nodes.push({ camera: 0, name: "front", translation: [0, 1, 4.2] }, { camera: 1, name: "near", translation: [0.2, 1, 2] });
    json.scenes[0].nodes.push(json.nodes.length - 2, json.nodes.length - 1);
    json.extensions.LIGHTWELL_neural_radiance.exposure = 1.5;
  },
});
const STYLE = "<style>body{margin:0} lightwell-viewer{width:120px;height:90px}</style>";

let browser: Browser;
let tab: { page: Page; errors: string[] };
let code = "";
const site = new Site();

beforeAll(async () => {
  await site.open();
  browser = await launch("llvmpipe");
  tab = await openPage(browser, 400, 300);
  code = await bundle(ENTRY);
  site.put("/scene.glb", writeGlb(room));
  const svg = `<svg xmlns="http://www.w3.org/2000/svg" width="4" height="3"><rect width="4" height="3" fill="red"/></svg>`;
  site.put("/poster.svg", Buffer.from(svg));
});

afterAll(async () => {
  await browser?.close();
  await site.close();
});

async function open(name: string, elements: string): Promise<{ page: Page; errors: string[] }> {
  tab.errors.length = 0;
  await tab.page.goto(site.put(`/${name}.html`, modulePage(code, `${STYLE}${elements}`)));
  return tab;
}

const loaded = (page: Page, count: number) =>
  page.waitForFunction((wanted) => [...document.querySelectorAll("lightwell-viewer")].filter((viewer: any) => viewer.scene && !viewer.shadowRoot.querySelector("p").textContent).length === wanted, count);

/** Mean of the middle of an element's canvas. */
const middle = (page: Page, index = 0) =>
  page.evaluate((i) => {
    const canvas = document.querySelectorAll("lightwell-viewer")[i]!.shadowRoot!.querySelector("canvas")!;
    const { data } = canvas.getContext("2d")!.getImageData(canvas.width / 4, canvas.height / 4, canvas.width / 2, canvas.height / 2);
    return data.reduce((sum, x) => sum + x, 0) / data.length;
  }, index);

it("many on one page share one renderer, each with its own picture, and free it", async () => {
  const { page, errors } = await open(
    "many",
    '<lightwell-viewer src="/scene.glb"></lightwell-viewer><lightwell-viewer src="/scene.glb" camera="near"></lightwell-viewer><lightwell-viewer src="/scene.glb" exposure="0.2"></lightwell-viewer>',
  );
  await loaded(page, 3);
  const [first, near, dark] = [await middle(page, 0), await middle(page, 1), await middle(page, 2)];
  expect(first).toBeGreaterThan(dark! + 20);
  expect(Math.abs(first - near)).toBeGreaterThan(0.5);
  expect(await page.evaluate(() => (window as any).contexts)).toBe(1);
  // The last one takes the renderer along; the next one makes another.
  await page.evaluate(() => {
    for (const viewer of [...document.querySelectorAll("lightwell-viewer")].slice(1)) viewer.remove();
    const viewer = document.querySelector("lightwell-viewer")!;
    viewer.remove();
    document.body.append(viewer);
  });
  await loaded(page, 1);
  expect(await middle(page)).toBeCloseTo(first, 0);
  expect(await page.evaluate(() => (window as any).contexts)).toBe(2);
  // The test itself reads back often.
  expect(errors.filter((text) => !text.startsWith("Canvas2D"))).toEqual([]);
});

it("stands at the file's camera of a name, at a place, or at the first camera, with the file's exposure", async () => {
  const { page } = await open("cameras", '<lightwell-viewer src="/scene.glb" controls></lightwell-viewer>');
  await loaded(page, 1);
  const stand = (camera: string | null) =>
    page.evaluate((text) => {
      const viewer = document.querySelector("lightwell-viewer") as any;
      if (text === null) viewer.removeAttribute("camera");
      else viewer.setAttribute("camera", text);
      return [...viewer.camera.position.toArray(), viewer.camera.fov].map((x: number) => Number(x.toFixed(2)));
    }, camera);
  expect(await stand(null)).toEqual([0, 1, 4.2, 34.38]);
  expect(await stand("near")).toEqual([0.2, 1, 2, 34.38]);
  expect(await stand("1 2 3 / 0 1 0")).toEqual([1, 2, 3, 40]);
  expect(await page.evaluate(() => (document.querySelector("lightwell-viewer") as any).scene.exposure)).toBe(1.5);
});

it("puts what moves to its share of the range, which wins over its value", async () => {
  site.put("/door.glb", readFileSync(new URL("fixtures/field-and-probes.glb", import.meta.url)));
  const { page } = await open("door", '<lightwell-viewer src="/door.glb" door="0.5"></lightwell-viewer>');
  await loaded(page, 1);
  const door = (name: string | null, value: string | null) =>
    page.evaluate(
      async ([name, value]) => {
        const viewer = document.querySelector("lightwell-viewer") as any;
        if (name && value === null) viewer.removeAttribute(name);
        else if (name) viewer.setAttribute(name, value);
        await new Promise((resolve) => setTimeout(resolve));
        return viewer.scene.movers[0].value as number;
      },
      [name, value] as const,
    );
  expect(await door(null, null)).toBe(45);
  expect(await door("door", "2")).toBe(90);
  expect(await door("movers", "Door:20")).toBe(90);
  expect(await door("door", "ajar")).toBe(20);
  expect(await door("door", "0.1")).toBeCloseTo(9, 5);
  expect(await door("door", null)).toBe(20);
});

it("says once which of its attributes are misspelled, with what varies", async () => {
  site.put("/door.glb", readFileSync(new URL("fixtures/field-and-probes.glb", import.meta.url)));
  const html = '<lightwell-viewer src="/door.glb" dor="0.5" class="a" id="b" tabindex="0" title="c" data-x="d"></lightwell-viewer>';
  const { page } = await open("misspelled", html);
  const said: string[] = [];
  page.on("console", (message) => void (message.type() === "warning" && said.push(message.text())));
  await loaded(page, 1);
  await page.evaluate(async () => {
    const viewer = document.querySelector("lightwell-viewer") as any;
    for (const value of ["0.1", "0.2"]) for (const name of ["dor", "lamp", "hidden"]) viewer.setAttribute(name, value);
    viewer.setAttribute("movers", "Dor:3");
    await new Promise((resolve) => setTimeout(resolve));
  });
  const ours = () => said.filter((text) => text.startsWith("lightwell-viewer")).map((text) => text.split(" ")[1]);
  await expect.poll(() => ours().sort()).toEqual(["'Dor'", "'dor'", "'lamp'"]);
  expect(said.find((text) => text.includes("'dor'"))).toMatch(/what varies: 'door', .*'movers'$/);
});

it("sets lamps and the light as its attributes say from the first frame on", async () => {
  const lamp = { name: "desk", nodes: [], intensity: 1, color: [1, 1, 1] };
  const tamper = (json: any) => void Object.assign(json.extensions.LIGHTWELL_neural_radiance, { version: 2, lamps: [lamp] });
  site.put("/lamps.glb", writeGlb(plainRoom({ tamper })));
  const { page } = await open("lamps", '<lightwell-viewer src="/lamps.glb" lamps="desk:0.3" light="0.2 0.9 0.1"></lightwell-viewer>');
  await loaded(page, 1);
  const state = () =>
    page.evaluate(() => {
      const { scene } = document.querySelector("lightwell-viewer") as any;
      return { desk: scene.switches[0].intensity, light: scene.lamps[0].value.toArray() };
    });
  expect(await state()).toEqual({ desk: 0.3, light: [0.2, 0.9, 0.1] });
  await page.evaluate(() => document.querySelector("lightwell-viewer")!.removeAttribute("lamps"));
  expect((await state()).desk).toBe(1);
});

it("draws nothing before its shaders are compiled, and then with these: to wait for shaders would hold up the page", async () => {
  // Shaders take their time, and frames go by.
  const slow = `<script>
    const began = performance.now();
    const ask = WebGL2RenderingContext.prototype.getProgramParameter;
    WebGL2RenderingContext.prototype.getProgramParameter = function (program, name) {
      if (name === 0x91b1) window.compiled ??= window.sources;
      return name === 0x91b1 && performance.now() < began + 1500 ? false : ask.call(this, program, name);
    };
    window.sources = 0;
    const give = WebGL2RenderingContext.prototype.shaderSource;
    WebGL2RenderingContext.prototype.shaderSource = function (shader, source) {
      window.sources += source.includes("lightwellRadiance");
      return give.call(this, shader, source);
    };
    window.copies = 0;
    const copy = CanvasRenderingContext2D.prototype.drawImage;
    CanvasRenderingContext2D.prototype.drawImage = function (...given) {
      window.copies++;
      return copy.apply(this, given);
    };
    addEventListener("load", () => document.querySelector("lightwell-viewer").addEventListener("load", () => (window.first ??= [window.copies, window.sources - window.compiled])));
  </script>`;
  const { page } = await open("slow", `${slow}<lightwell-viewer src="/scene.glb"></lightwell-viewer>`);
  await page.waitForFunction(() => "first" in window);
  expect(await page.evaluate(() => (window as any).compiled)).toBeGreaterThan(0);
  expect(await page.evaluate(() => (window as any).first)).toEqual([1, 0]);
});

it("shows a poster and how much has come, waits until it is near, and says what is seen", async () => {
  const { page } = await open(
    "lazy",
    '<div style="height:4000px"></div><lightwell-viewer src="/scene.glb" poster="/poster.svg" alt="A red and green room" loading="lazy"></lightwell-viewer>',
  );
  const state = () =>
    page.evaluate(() => {
      const { shadowRoot } = document.querySelector("lightwell-viewer")!;
      const canvas = shadowRoot!.querySelector("canvas")!;
      return { poster: !shadowRoot!.querySelector("img")!.hidden, name: canvas.getAttribute("aria-label"), role: canvas.getAttribute("role"), tab: canvas.tabIndex };
    });
  await page.evaluate(() => {
    const viewer = document.querySelector("lightwell-viewer")!;
    viewer.addEventListener("progress", (event) => ((window as any).told = (event as ProgressEvent).loaded));
  });
  expect(await state()).toEqual({ poster: true, name: "A red and green room", role: "img", tab: -1 });
  expect(await page.evaluate(() => (window as any).contexts)).toBe(0);
  await page.evaluate(() => document.querySelector("lightwell-viewer")!.scrollIntoView());
  await loaded(page, 1);
  expect(await page.evaluate(() => (window as any).told)).toBe(writeGlb(room).length);
  expect((await state()).poster).toBe(false);
  await page.evaluate(() => document.querySelector("lightwell-viewer")!.setAttribute("controls", ""));
  expect((await state()).tab).toBe(0);
});

it("shows what surrounds a scene", async () => {
  const tamper = (json: any) => void (json.extensions.LIGHTWELL_neural_radiance.environment = { radiance: [0.25, 0.5, 1] });
  site.put("/sky.glb", writeGlb(plainRoom({ tamper })));
  const { page, errors } = await open("sky", '<lightwell-viewer src="/sky.glb" camera="0 1 3 / 0 1 5" tone-mapping="none" exposure="1"></lightwell-viewer>');
  await loaded(page, 1);
  const pixel = await page.evaluate(() => {
    const canvas = document.querySelector("lightwell-viewer")!.shadowRoot!.querySelector("canvas")!;
    return Array.from(canvas.getContext("2d")!.getImageData(canvas.width / 2, canvas.height / 2, 1, 1).data);
  });
  // sRGB of 0.25, 0.5 and 1.
  pixel.forEach((x, i) => expect(Math.abs(x - [137, 188, 255, 255][i]!)).toBeLessThanOrEqual(1));
  expect(errors).toEqual([]);
});

it("turns the environment map that may turn, and leaves what cannot be turned so far", async () => {
  const map = { kind: "environment", name: "environment", range: [0, 180], initial: [0, 0, -1], intensity: 1, color: [1, 1, 1] };
  const tamper = (json: any) => void Object.assign(json.extensions.LIGHTWELL_neural_radiance, { version: 2, environment: { radiance: [1, 1, 1] } });
  site.put("/turn.glb", writeGlb(plainRoom({ variables: [map], fields: [stillField()], tamper })));
  const { page, errors } = await open("turn", '<lightwell-viewer src="/turn.glb" environment-rotation="90"></lightwell-viewer>');
  await loaded(page, 1);
  const north = () => page.evaluate(() => [...(document.querySelector("lightwell-viewer") as any).scene.lamps[0].value].map((x: number) => Math.round(x * 100) / 100));
  expect(await north()).toEqual([1, 0, -0]);
  for (const [asked, expected] of [["0", [0, 0, -1]], ["270", [0, 0, -1]], ["", [0, 0, -1]]] as const) {
    await page.evaluate((value) => document.querySelector("lightwell-viewer")!.setAttribute("environment-rotation", value), asked);
    expect(await north()).toEqual(expected);
  }
  expect(errors).toEqual([]);
});
