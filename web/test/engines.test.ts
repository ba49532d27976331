/** A-Frame, Babylon.js and PlayCanvas show the pictures of three.js, and what is done to their lights counts. */

import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, describe, expect, it } from "vitest";
import type { Shot } from "./pages/engines-shot.ts";
import { launch, openPage, Site } from "./support/browser.ts";
import { bundle, modulePage } from "./support/bundle.ts";
import { furnishedRoom, linearField, stillField } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";
import { buildPackage } from "./support/package.ts";

/** Pictures of two engines agree to this many decibels. */
const AGREE = 40;
const ALL = { raster: true, indirect: true, still: true };
/** Everything; the learned light alone; another place of the lamp. */
const SHOTS: readonly Shot[] = [
  { light: null, parts: ALL },
  { light: null, parts: { ...ALL, raster: false } },
  { light: [0.4, 1.0, 0.4], parts: ALL },
];

let browser: Browser;
const site = new Site();
const bytes = writeGlb(furnishedRoom({ fields: [linearField(), stillField()] }));
const glb = Buffer.from(bytes).toString("base64");
const file = (path: string): string => fileURLToPath(new URL(`../${path}`, import.meta.url));

type Picture = readonly number[];

/** The pictures of a page that a module makes. */
async function shoot(entry: string, attributes = ""): Promise<Picture[]> {
  return shootPage(`/${entry}${attributes}.html`, modulePage(await bundle(`pages/${entry}.ts`), `<body data-glb="${glb}" ${attributes}>`));
}

async function shootPage(path: string, html: string): Promise<Picture[]> {
  const { page, errors } = await openPage(browser);
  await page.goto(site.put(path, html));
  await page.waitForFunction(() => "shoot" in window).catch(() => expect(errors).toEqual([]));
  const pictures: Picture[] = [];
  for (const shot of SHOTS) pictures.push(await page.evaluate((asked) => (window as any).shoot(asked), shot as never));
  expect(errors).toEqual([]);
  await page.close();
  return pictures;
}

function psnr(a: Picture, b: Picture): number {
  const mse = a.reduce((sum, x, i) => sum + ((x - b[i]!) / 255) ** 2, 0) / a.length;
  return -10 * Math.log10(Math.max(mse, 1e-12));
}

let truth: Picture[];

beforeAll(async () => {
  await site.open();
  browser = await launch("swiftshader");
  truth = await shoot("engines-three");
});

/** Decibels of the picture that agrees least, by engine: written for `benchmarks/web.py`. */
const least: Record<string, number> = {};

afterAll(async () => {
  mkdirSync(file("test-results"), { recursive: true });
  writeFileSync(file("test-results/engines.json"), `${JSON.stringify(least, null, 1)}\n`);
  await browser?.close();
  await site.close();
});

function agree(engine: string, found: readonly Picture[]): void {
  const decibels = found.map((picture, i) => psnr(picture, truth[i]!));
  // The three differ from each other, so that agreement says something.
  expect(psnr(truth[0]!, truth[2]!)).toBeLessThan(30);
  least[engine] = Math.min(...decibels);
  expect(least[engine], decibels.map((x) => x.toFixed(1)).join(", ")).toBeGreaterThan(AGREE);
}

describe("lightwell/babylon", () => {
  it.each(process.env.LIGHTWELL_LONG_TESTS || process.env.LIGHTWELL_MEASURE ? ["left", "right"] : ["left"])("draws what three.js draws, in %s-handed axes", async (hand) => {
    agree(`babylon ${hand}`, await shoot("engines-babylon", `data-hand=${hand}`));
  });
});

describe("lightwell/playcanvas", () => {
  it("draws what three.js draws", async () => {
    agree("playcanvas", await shoot("engines-playcanvas"));
  });
});

/** Draws with A-Frame's own renderer, from the camera of the others. */
const AFRAME_PAGE = `<script src="/aframe.js"></script>
<a-scene embedded style="width:160px;height:120px" light="defaultLightsEnabled: false" renderer="antialias: false" xr-mode-ui="enabled: false">
  <a-entity id="room" lightwell="src: /scene.glb"></a-entity>
</a-scene>`;
const AFRAME_SHOOT = `
const loaded = new Promise((resolve) => document.getElementById("room").addEventListener("model-loaded", resolve));
window.shoot = async ({ light, parts }) => {
  await loaded;
  const { THREE } = AFRAME;
  const room = document.getElementById("room");
  const { renderer, object3D } = room.sceneEl;
  const { learned } = room.components.lightwell;
  room.setAttribute("lightwell", { light: (light ?? learned.lamps[0].variable.initial).join(" ") });
  learned.show(parts);
  learned.update();
  const camera = new THREE.PerspectiveCamera(36, 160 / 120, 0.05, 50);
  camera.position.set(0.9, 1.3, 4.1);
  camera.lookAt(0, 0.9, 0);
  renderer.setPixelRatio(1);
  renderer.setSize(160, 120, false);
  renderer.setRenderTarget(null);
  object3D.background = null;
  renderer.render(object3D, camera);
  const gl = renderer.getContext();
  const rows = new Uint8Array(4 * 160 * 120);
  gl.readPixels(0, 0, 160, 120, gl.RGBA, gl.UNSIGNED_BYTE, rows);
  return Array.from(rows).filter((_, i) => i % 4 < 3);
};`;

describe("lightwell/aframe", () => {
  it("draws with A-Frame's three.js what three.js draws", async () => {
    buildPackage();
    site.put("/aframe.js", readFileSync(file("node_modules/aframe/dist/aframe-v1.8.0.min.js")));
    site.put("/scene.glb", bytes);
    const code = readFileSync(file("runtime/dist/lightwell-aframe.js"), "utf8");
    agree("aframe", await shootPage("/aframe.html", modulePage(`${code}\n${AFRAME_SHOOT}`, AFRAME_PAGE)));
  });
});
