/** The snippets of docs/web.md, as they stand there, show what the page of the bake shows: its exposure is in the file. */

import { readFileSync } from "node:fs";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect, it } from "vitest";
import { launch, openPage, Site } from "./support/browser.ts";
import { bundle, modulePage } from "./support/bundle.ts";
import { CAMERA, furnishedRoom } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";
import { pageWith } from "./support/page.ts";
import { likenessOf } from "./support/stored-picture.ts";

const GUIDE = readFileSync(new URL("../../docs/web.md", import.meta.url), "utf8");
const EXPOSURE = 2.5;
const [WIDTH, HEIGHT] = [160, 120];

let browser: Browser;
let room: Buffer;
let tab: { page: Page; errors: string[] };
const site = new Site();

beforeAll(async () => {
  await site.open();
  browser = await launch("llvmpipe");
  tab = await openPage(browser, WIDTH, HEIGHT);
  site.put("/scene.glb", bakedRoom());
  // Any picture: it is gone when the scene is there.
  site.put("/scene.webp", readFileSync(new URL("pictures/three-desktop.png", import.meta.url)));
  const query = `?ui=0&dither=0&camera=${[...CAMERA.position, ...CAMERA.target, CAMERA.fov_y].join(",")}`;
  const page = pageWith(bakedRoom(), { title: "Room", home: CAMERA, exposure: EXPOSURE });
  room = await shown(page, () => window.lightwell?.ready.then(() => true), query);
}, 120_000);

afterAll(async () => {
  await browser?.close();
  await site.close();
});

/** A file as a bake writes it: with its exposure unless there is none, and a camera where the page opens. */
function bakedRoom(exposure: number | null = EXPOSURE): Uint8Array<ArrayBuffer> {
  return writeGlb(
    furnishedRoom({
      tamper: (json: any) => {
        if (exposure !== null) json.extensions.LIGHTWELL_neural_radiance.exposure = exposure;
        json.cameras = [{ type: "perspective", perspective: { yfov: (CAMERA.fov_y * Math.PI) / 180, znear: 0.01 } }];
        json.scenes[0].nodes.push(json.nodes.push({ camera: 0, translation: CAMERA.position }) - 1);
      },
    }),
  );
}

/** Blocks of code of a language below a heading of the guide. */
function snippets(heading: string, language: string): string[] {
  const section = GUIDE.split(/^## /m).find((text) => text.startsWith(heading))!;
  return [...section.matchAll(new RegExp(`^\`\`\`${language}\\n(.*?)^\`\`\``, "gms"))].map((match) => match[1]!);
}

/** A picture of a page, taken when `ready` holds there. */
async function shown(html: string, ready: () => unknown, query = ""): Promise<Buffer> {
  const { page, errors } = tab;
  await page.goto(site.put("/index.html", html) + query);
  await page.waitForFunction(ready).catch(() => expect(errors).toEqual([]));
  const picture = await page.screenshot();
  expect(errors).toEqual([]);
  return picture;
}

/** A page that has a renderer, a scene and a camera, with the three lines and those for the tone curve. */
async function threeLines(): Promise<string> {
  const [lines, curve] = snippets("three.js in three lines", "ts");
  const code = await bundle(`
    import { AgXToneMapping, PerspectiveCamera, Scene, WebGLRenderer } from "three";
    import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
    import { LearnedScene, LightwellLoaderPlugin } from "lightwell";
    const renderer = new WebGLRenderer({ antialias: true });
    const scene = new Scene();
    ${lines}
    ${curve}
    document.body.append(renderer.domElement);
    renderer.setSize(${WIDTH}, ${HEIGHT});
    const camera = new PerspectiveCamera(${CAMERA.fov_y}, ${WIDTH / HEIGHT}, 0.01, 100);
    camera.position.set(${CAMERA.position.join(", ")});
    renderer.setAnimationLoop(() => {
      learned.update();
      renderer.render(scene, camera);
      document.body.dataset.frames = String(Number(document.body.dataset.frames ?? 0) + 1);
    });`);
  return modulePage(code, "<body><style>body { margin: 0 }</style>");
}

/** A few per cent: the page smooths edges and shadows in its own way. */
async function expectSame(picture: Buffer): Promise<void> {
  const { mean, off } = await likenessOf(tab.page, picture, room);
  expect(mean).toBeLessThan(0.02);
  expect(off).toBeLessThan(0.05);
}

it("three lines of three.js, and three for the tone curve", async () => {
  const page = await threeLines();
  const drawn = () => Number(document.body.dataset.frames) > 2;
  await expectSame(await shown(page, drawn));
  // The exposure makes the picture.
  site.put("/scene.glb", bakedRoom(null));
  await expect(expectSame(await shown(page, drawn))).rejects.toThrow();
  site.put("/scene.glb", bakedRoom());
});

it("the custom element", async () => {
  const [tag] = snippets("The custom element", "html");
  const code = await bundle('import("lightwell/element");');
  const style = `<style>body { margin: 0 } lightwell-viewer { display: block; width: ${WIDTH}px; height: ${HEIGHT}px }</style>`;
  const loaded = () => (document.querySelector("lightwell-viewer") as any)?.scene;
  await expectSame(await shown(modulePage(code, `<body>${style}${tag}`), loaded));
});
