/**
 * The snippets of docs/web.md, as they stand there, show what the page of the bake shows under the same light, camera and tone curve.
 * Around each stands what its section says that a reader has: a renderer, a camera, a scene, an element to draw into.
 */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import type { Browser, Page } from "playwright-core";
import { afterAll, afterEach, beforeAll, expect, it } from "vitest";
import { COARSE, launch, openPage, Site } from "./support/browser.ts";
import { bundle, modulePage } from "./support/bundle.ts";
import { CAMERA, furnishedRoom, LAMP } from "./support/fixtures.ts";
import { type Fixture, matte, writeGlb } from "./support/glb.ts";
import { buildPackage } from "./support/package.ts";
import { pageWith } from "./support/page.ts";
import { likenessOf } from "./support/stored-picture.ts";

const GUIDE = readFileSync(new URL("../../docs/web.md", import.meta.url), "utf8");

/** Blocks of code of a language below a heading of the guide. */
function snippets(heading: string, language: string): string[] {
  const section = GUIDE.split(/^## /m).find((text) => text.startsWith(heading))!;
  return [...section.matchAll(new RegExp(`^\`\`\`(?:${language})\\n(.*?)^\`\`\``, "gms"))].map((match) => match[1]!);
}

/** Code between back quotes in a sentence of the guide, by how it begins. */
function inline(beginning: string): string {
  const at = GUIDE.indexOf(`\`${beginning}`);
  if (at < 0) throw new Error(`docs/web.md: expected code that begins with '${beginning}'`);
  return GUIDE.slice(at + 1, GUIDE.indexOf("`", at + 1));
}

const [LINES, CURVE, NODE] = snippets("three.js in three lines", "ts");
const [FIBER] = snippets("three.js in three lines", "tsx");
const [ELEMENT] = snippets("The custom element", "html");
const [AFRAME] = snippets("A-Frame", "html");
const [BABYLON] = snippets("Babylon.js", "ts");
const [PLAYCANVAS] = snippets("PlayCanvas", "ts");
const [FRAME] = snippets("The page of a bake", "html");
const [BUDGET] = snippets("Files from strangers", "ts");
/** Code in sentences. */
const LOAD_LIGHT = inline("await loadLight(");
const MESSAGE = inline("frame.contentWindow.postMessage(");

const EXPOSURE = 2.5;
const [WIDTH, HEIGHT] = [160, 120];
/** Where the snippets that move the lamp put it. */
const MOVED = "0.3,1.2,0.2";
/** The tone curves of @react-three/fiber and of A-Frame; cameras of the first look at the origin, and the second has one of its own. */
const OF_FIBER = { camera: "0,1,4.2,0,0,0,36", tonemap: "aces", exposure: "1", lights: MOVED };
const OF_AFRAME = { camera: "0,1.6,0,0,1.6,-1,80", tonemap: "none", exposure: "1", lights: MOVED };
/** Cameras of the tests draw linear light. */
const LINEAR = { tonemap: "none", exposure: "1" };

type Tab = { page: Page; errors: string[] };

let browser: Browser;
let room: Buffer;
let tab: Tab;
const site = new Site();
const file = (path: string) => readFileSync(fileURLToPath(new URL(`../${path}`, import.meta.url)));

beforeAll(async () => {
  buildPackage();
  await site.open();
  browser = await launch("llvmpipe");
  tab = await openPage(browser, WIDTH, HEIGHT);
  site.put("/scene.glb", bakedRoom());
  // Any picture: it is gone when the scene is there.
  site.put("/scene.webp", file("test/pictures/three-desktop.png"));
  room = await ofThePage();
}, 240_000);

// What is not looked at must not go on drawing while the next snippet is bundled.
afterEach(async () => void (await tab.page.goto("about:blank")));

afterAll(async () => {
  await browser?.close();
  await site.close();
});

/** A file as a bake writes it: with its exposure unless there is none, and a camera where the page opens. */
function bakedRoom(exposure: number | null = EXPOSURE, change: Partial<Fixture> = {}): Uint8Array<ArrayBuffer> {
  return writeGlb(
    furnishedRoom({
      tamper: (json: any) => {
        if (exposure !== null) json.extensions.LIGHTWELL_neural_radiance.exposure = exposure;
        json.cameras = [{ type: "perspective", perspective: { yfov: (CAMERA.fov_y * Math.PI) / 180, znear: 0.01 } }];
        json.scenes[0].nodes.push(json.nodes.push({ camera: 0, translation: CAMERA.position }) - 1);
      },
      ...change,
    }),
  );
}

/** The model alone, as it was before it was baked. */
function unlitRoom(): Uint8Array<ArrayBuffer> {
  return writeGlb(
    furnishedRoom({
      tamper: (json: any) => {
        delete json.extensions.LIGHTWELL_neural_radiance;
        json.extensionsUsed = json.extensionsUsed.filter((name: string) => name !== "LIGHTWELL_neural_radiance");
      },
    }),
  );
}

/** Warnings of others: @react-three/fiber 9 and A-Frame use what three.js 0.187 warns of, and A-Frame says who it is. */
const isOfOthers = (text: string) => /^THREE\.(Clock|WebGLShadowMap): |A-Frame|aframe|webvr-polyfill/i.test(text);
const said = ({ errors }: Tab) => errors.filter((text) => !isOfOthers(text));

/** A picture of a page, taken when `ready` holds there. */
async function shown(html: string, ready: () => unknown, query = "", on = tab): Promise<Buffer> {
  on.errors.length = 0;
  await on.page.goto(site.put("/index.html", html) + query);
  await on.page.waitForFunction(ready).catch((error) => {
    expect(said(on)).toEqual([]);
    throw error;
  });
  const picture = await on.page.screenshot({ animations: "disabled" });
  expect(said(on)).toEqual([]);
  return picture;
}

/** What the page of the bake shows with options of its address. */
async function ofThePage(options: Readonly<Record<string, string>> = {}, glb = bakedRoom()): Promise<Buffer> {
  const home = [...CAMERA.position, ...CAMERA.target, CAMERA.fov_y].join(",");
  const query = new URLSearchParams({ ui: "0", dither: "0", camera: home, ...options });
  const page = pageWith(glb, { title: "Room", home: CAMERA, exposure: EXPOSURE });
  return shown(page, () => window.lightwell?.ready.then(() => true), `?${query}`);
}

/** A few per cent: engines smooth edges and shadows in their own ways. */
async function expectSame(picture: Buffer, reference = room): Promise<void> {
  const { mean, off } = await likenessOf(tab.page, picture, reference);
  expect(mean).toBeLessThan(0.02);
  expect(off).toBeLessThan(0.05);
}

const drawn = () => Number(document.body.dataset.frames) > 2;
/** That of the page. */
const BACKGROUND = [11, 12, 15];
const BACKDROP = BACKGROUND.map((x) => x / 255).join(", ");
const STYLE = `<style>body { margin: 0; background: rgb(${BACKGROUND}) } canvas { display: block } .a-enter-vr { display: none }</style>`;

/** Run a module that counts its frames, and hold what it draws against a picture. */
async function expectDrawn(code: string, reference = room): Promise<void> {
  const page = modulePage(await bundle(code), `<body>${STYLE}`);
  await expectSame(await shown(page, drawn), reference);
}

/** Wait for a page, of which nothing says when it is ready, to show a picture. */
async function expectSoon(html: string, reference: Buffer): Promise<void> {
  await shown(html, () => document.querySelector("canvas"));
  await expect.poll(async () => expectSame(await tab.page.screenshot({ animations: "disabled" }), reference), { timeout: 20_000, interval: 300 }).toBe(undefined);
  expect(said(tab)).toEqual([]);
}

const COUNT = 'document.body.dataset.frames = String(Number(document.body.dataset.frames ?? 0) + 1);';
const SIZED = `Object.assign(document.createElement("canvas"), { width: ${WIDTH}, height: ${HEIGHT} })`;

/** A page of three.js that has a renderer, a scene, and a camera where the page opens; `lines` give it `learned`. */
const ofThree = (lines: string, { imports = "", renderer = "new WebGLRenderer({ alpha: true, antialias: true })" } = {}) => `
  import { AgXToneMapping, Mesh, PerspectiveCamera, Scene, WebGLRenderer } from "three";
  import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
  ${imports}
  const renderer = ${renderer};
  const scene = new Scene();
  const camera = new PerspectiveCamera(${CAMERA.fov_y}, ${WIDTH / HEIGHT}, 0.01, 100);
  camera.position.set(${CAMERA.position.join(", ")});
  renderer.setSize(${WIDTH}, ${HEIGHT});
  document.body.append(renderer.domElement);
  ${lines}
  renderer.setAnimationLoop(() => {
    learned.update();
    renderer.render(scene, camera);
    ${COUNT}
  });`;
const OF_LIGHTWELL = { imports: 'import { LearnedScene, LightwellLoaderPlugin, loadLight, parseLearned } from "lightwell";' };

it("three lines of three.js, and three for the tone curve", async () => {
  const code = ofThree(`${LINES}\n${CURVE}`, OF_LIGHTWELL);
  await expectDrawn(code);
  // The exposure makes the picture.
  site.put("/scene.glb", bakedRoom(null));
  await expect(expectDrawn(code)).rejects.toThrow();
  site.put("/scene.glb", bakedRoom());
});

it("loadLight, for a model that was loaded elsewhere", async () => {
  site.put("/model.glb", unlitRoom());
  const lines = `
    const { scene: model } = await new GLTFLoader().loadAsync("model.glb");
    scene.add(model);
    const learned = ${LOAD_LIGHT};`;
  await expectDrawn(ofThree(`${lines}\n${CURVE}`, OF_LIGHTWELL));
});

it("a file from strangers, with a budget of its own", async () => {
  const [plugin, ...rest] = BUDGET!.trim().split("\n");
  const lines = `
    const bytes = await (await fetch("scene.glb")).arrayBuffer();
    const loader = new GLTFLoader().register((parser) => { const plugin = ${plugin}
      return plugin;
    });
    ${rest.join("\n")}
    const learned = new LearnedScene(gltf, { renderer });
    scene.add(learned.root);`;
  await expectDrawn(ofThree(`${lines}\n${CURVE}`, OF_LIGHTWELL));
});

it("a field as a node of WebGPURenderer", async () => {
  // The root stands elsewhere, and the camera with it.
  const lines = `
    await renderer.init();
    const loader = new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser));
    const learned = new LearnedNodeScene(await loader.loadAsync("scene.glb"), { renderer });
    scene.add(learned.root);
    learned.root.add(camera);
    learned.root.position.set(0.4, 0.2, 0);
    learned.root.updateMatrixWorld();
    const material = new MeshBasicNodeMaterial();
    ${NODE}
    learned.root.traverse((object) => { if (object instanceof Mesh) object.material = material; });`;
  const imports = `
    import { LearnedNodeScene, LightwellLoaderPlugin, learnedRadiance } from "lightwell/webgpu";
    import { MeshBasicNodeMaterial, WebGPURenderer } from "three/webgpu";`;
  const code = ofThree(`${lines}\n${CURVE}`, { imports, renderer: "new WebGPURenderer({ alpha: true, antialias: true, forceWebGL: true })" });
  // Surfaces that reflect all: base colour plus 0.04.
  const white = bakedRoom(EXPOSURE, { materials: [0, 1, 2, 3].map(() => matte(0.96, 0.96, 0.96)) });
  const reference = await ofThePage({ mode: "indirect" }, white);
  await expectDrawn(code, reference);
});

it("@react-three/fiber", async () => {
  const [, imports, element] = /^((?:import [^\n]*\n)*)(.*)$/s.exec(FIBER!)!;
  const code = `
    import { Canvas } from "@react-three/fiber";
    import { Suspense } from "react";
    import { createRoot } from "react-dom/client";
    ${imports}
    createRoot(document.getElementById("root")!).render(${element});`;
  const body = `<div id="root" style="width: ${WIDTH}px; height: ${HEIGHT}px"></div>`;
  const reference = await ofThePage(OF_FIBER);
  await expectSoon(modulePage(await bundle(code), `<body>${STYLE}${body}`), reference);
});

it("the custom element", async () => {
  const code = await bundle('import("lightwell/element");');
  const style = `<style>body { margin: 0 } lightwell-viewer { display: block; width: ${WIDTH}px; height: ${HEIGHT}px }</style>`;
  const loaded = () => (document.querySelector("lightwell-viewer") as any)?.scene;
  await expectSame(await shown(modulePage(code, `<body>${style}${ELEMENT}`), loaded));
});

it("A-Frame", async () => {
  const script = { "content-type": "text/javascript" };
  site.put("/lightwell-aframe.js", file("runtime/dist/lightwell-aframe.js"), script);
  await tab.page.route("https://aframe.io/**", (route) => route.fulfill({ headers: script, body: file("node_modules/aframe/dist/aframe-v1.8.0.min.js") }));
  const reference = await ofThePage(OF_AFRAME);
  await expectSoon(`<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,"><body>${STYLE}${AFRAME}`, reference);
  await tab.page.unroute("https://aframe.io/**");
});

it("Babylon.js", async () => {
  const code = `
    import { FreeCamera } from "@babylonjs/core/Cameras/freeCamera.js";
    import { Engine } from "@babylonjs/core/Engines/engine.js";
    import { Color4 } from "@babylonjs/core/Maths/math.color.js";
    import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
    import { Scene as Room } from "@babylonjs/core/scene.js";
    ${BABYLON}
    const canvas = document.body.appendChild(${SIZED});
    const engine = new Engine(canvas, true);
    const room = new Room(engine);
    room.clearColor = new Color4(${BACKDROP}, 1);
    room.useRightHandedSystem = true;
    const camera = new FreeCamera("camera", new Vector3(${CAMERA.position.join(", ")}), room);
    camera.setTarget(new Vector3(${CAMERA.target.join(", ")}));
    camera.fov = ${(CAMERA.fov_y * Math.PI) / 180};
    camera.minZ = 0.01;
    await show(room);
    await room.whenReadyAsync();
    engine.runRenderLoop(() => { room.render(); ${COUNT} });`;
  await expectDrawn(code, await ofThePage({ ...LINEAR, lights: `${LAMP.initial.join(",")},fff3e7,${2 * LAMP.intensity}` }));
});

it("PlayCanvas", async () => {
  const code = `
    import { Application as App, Color, Entity, TONEMAP_NONE } from "playcanvas";
    ${PLAYCANVAS}
    const app = new App(document.body.appendChild(${SIZED}));
    app.setCanvasResolution("FIXED", ${WIDTH}, ${HEIGHT});
    app.scene.ambientLight = new Color(0, 0, 0);
    app.start();
    const eye = new Entity("camera", app);
    eye.addComponent("camera", { fov: ${CAMERA.fov_y}, nearClip: 0.01, clearColor: new Color(${BACKDROP}), toneMapping: TONEMAP_NONE });
    eye.setPosition(${CAMERA.position.join(", ")});
    app.root.addChild(eye);
    await show(app);
    app.on("frameend", () => { ${COUNT} });`;
  await expectDrawn(code, await ofThePage({ ...LINEAR, lights: MOVED }));
});

it("the page in a frame, and what is sent to it", async () => {
  const coarse = await openPage(browser, 960, 540, COARSE);
  const page = pageWith(bakedRoom(), { title: "Room", home: CAMERA, exposure: EXPOSURE });
  const alone = (query: string) => shown(page, () => window.lightwell?.ready.then(() => true), query, coarse);
  const learned = await alone("?mode=learned");
  const split = await alone("?mode=split&camera=0,1,4,0,1,0,40");
  site.put("/scene.html", page);
  const around = `<!doctype html><link rel="icon" href="data:,"><body style="margin: 0; overflow: hidden">${FRAME}`;
  const ready = () => (document.querySelector("iframe")!.contentWindow as Window).lightwell?.ready.then(() => true);
  await expectSame(await shown(around, ready, "", coarse), learned);
  await coarse.page.evaluate(async (text) => {
    const answered = new Promise<void>((resolve) => {
      addEventListener("message", ({ data }) => data.lightwell === "state" && data.id === 1 && resolve());
    });
    new Function("frame", text)(document.querySelector("iframe"));
    await answered;
  }, MESSAGE);
  const picture = await coarse.page.screenshot({ animations: "disabled" });
  await expectSame(picture, split);
  await expect(expectSame(picture, learned)).rejects.toThrow();
  expect(coarse.errors).toEqual([]);
  await coarse.page.close();
});

it("a picture without the learned light is told from the page's", async () => {
  await expect(expectSame(await ofThePage({ mode: "direct" }))).rejects.toThrow();
  await expect(expectSame(await ofThePage({ ...OF_FIBER, mode: "direct" }), await ofThePage(OF_FIBER))).rejects.toThrow();
});

it("no snippet that shows something is left out", () => {
  const run = [LINES, CURVE, NODE, FIBER, ELEMENT, AFRAME, BABYLON, PLAYCANVAS, FRAME, BUDGET];
  expect(run).toEqual(expect.arrayContaining([...GUIDE.matchAll(/^```(?:ts|tsx|html|js)\n(.*?)^```/gms)].map((match) => match[1])));
  expect(run).not.toContain(undefined);
});
