/** The examples run as they are, and the custom element loads, says what is wrong, and frees everything. */

import { existsSync, readFileSync } from "node:fs";
import { createServer, type Server } from "node:http";
import type { AddressInfo } from "node:net";
import { extname, join, normalize } from "node:path";
import { fileURLToPath } from "node:url";
import type { Browser, Page } from "playwright-core";
import { afterAll, afterEach, beforeAll, describe, expect, it } from "vitest";
import { launch, openPage } from "./support/browser.ts";
import { bundle, modulePage } from "./support/bundle.ts";
import { furnishedRoom, plainRoom } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";
import { buildPackage } from "./support/package.ts";
import { likeness, standStill } from "./support/stored-picture.ts";

const ROOT = fileURLToPath(new URL("../../", import.meta.url));
const TYPES: Record<string, string> = { ".html": "text/html", ".js": "text/javascript", ".glb": "model/gltf-binary" };

let browser: Browser;
/** Pages of which nothing moves. */
let still: Awaited<ReturnType<typeof openPage>>;
let server: Server;
let origin = "";
const extra = new Map<string, [type: string, body: string | Uint8Array]>();

beforeAll(async () => {
  buildPackage();
  extra.set("/examples/web/scene.glb", ["model/gltf-binary", writeGlb(furnishedRoom())]);
  extra.set("/broken.glb", ["model/gltf-binary", writeGlb(plainRoom({ tamper: (json: any) => void (json.extensions.LIGHTWELL_neural_radiance.version = 9) }))]);
  server = createServer((request, response) => {
    const path = new URL(request.url ?? "/", "http://x").pathname;
    const made = extra.get(path);
    const file = join(ROOT, normalize(path));
    if (!made && !(file.startsWith(ROOT) && extname(file) && existsSync(file))) {
      response.writeHead(404).end();
      return;
    }
    response.writeHead(200, { "content-type": made?.[0] ?? TYPES[extname(file)] ?? "application/octet-stream" });
    response.end(made ? made[1] : readFileSync(file));
  });
  await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
  origin = `http://127.0.0.1:${(server.address() as AddressInfo).port}`;
  browser = await launch("swiftshader");
  still = await openPage(browser);
  await standStill(still.page);
}, 240_000);

afterAll(async () => {
  await browser?.close();
  server?.closeAllConnections();
  server?.close();
});

/** How many different values a screenshot's middle has: blank pages have one. */
async function colours(page: Page): Promise<number> {
  const png = await page.screenshot();
  return page.evaluate(async (bytes) => {
    const image = await createImageBitmap(new Blob([Uint8Array.from(atob(bytes), (c) => c.charCodeAt(0))]));
    const context = new OffscreenCanvas(image.width, image.height).getContext("2d")!;
    context.drawImage(image, 0, 0);
    const { data } = context.getImageData(image.width / 4, image.height / 4, image.width / 2, image.height / 2);
    const seen = new Set<number>();
    for (let i = 0; i < data.length; i += 4) seen.add((data[i]! << 16) | (data[i + 1]! << 8) | data[i + 2]!);
    return seen.size;
  }, png.toString("base64"));
}

/** A few per cent: rasterisers round, and drivers filter shadows, each in its own way. */
const ALIKE = { mean: 0.02, off: 0.05 };
/** The small one is for those that take long for each pixel. */
const SCREENS = { phone: [120, 220], desktop: [200, 150], small: [100, 75] } as const;
type Screen = keyof typeof SCREENS;

async function isStored(page: Page, name: string): Promise<boolean> {
  const { mean, off } = await likeness(page, name);
  return mean < ALIKE.mean && off < ALIKE.off;
}

/** A page with a module of `examples/web`, for those that need a bundler. */
async function moduleExample(name: string): Promise<string> {
  const path = `${ROOT}examples/web/${name}`;
  const mount = `import { createElement } from "react"; import { createRoot } from "react-dom/client"; import { App } from "${path}"; createRoot(document.getElementById("root")!).render(createElement(App));`;
  const code = await bundle(name.endsWith("x") ? mount : `import "${path}";`);
  return modulePage(code, '<body><style>body { margin: 0 } canvas, #root { display: block; width: 100vw; height: 100vh }</style><canvas></canvas><div id="root"></div>');
}

/** Open an example on a screen of a size. */
async function openExample(name: string, screen: Screen): Promise<void> {
  const [width, height] = SCREENS[screen];
  if (!name.endsWith(".html")) extra.set(`/examples/web/${name}.html`, ["text/html", (await moduleExample(name)).replace(name.endsWith("x") ? "<canvas></canvas>" : '<div id="root"></div>', "")]);
  const { page, errors } = still;
  errors.length = 0;
  await page.setViewportSize({ width, height });
  await page.goto(`${origin}/examples/web/${name}${name.endsWith(".html") ? "" : ".html"}`);
  // On so small a screen the controls of the lens would hide what it draws.
  await page.addStyleTag({ content: "form, .a-enter-vr { display: none }" });
}

/** Warnings of others: @react-three/fiber 9 and A-Frame use what three.js 0.187 warns of, and A-Frame says who it is. */
const isOfOthers = (text: string) => /^THREE\.(Clock|WebGLShadowMap): |A-Frame|aframe|webvr-polyfill/i.test(text);

/** Examples of what other tests look at, too. */
const OTHERS = [
  ["three.html", "phone"],
  ["lens.html", "small"],
  ["element.html", "desktop"],
  ["aframe.html", "desktop"],
  ["babylon.ts", "small"],
  ["playcanvas.ts", "small"],
] as const;

describe("examples/web", () => {
  // What is not looked at must not go on drawing.
  afterEach(async () => void (await still.page.goto("about:blank")));

  it.each([
    ["three.html", "desktop"],
    ["webgpu.html", "desktop"],
    ["fiber.tsx", "desktop"],
    ...(process.env.LIGHTWELL_LONG_TESTS ? OTHERS : []),
  ] as const)("%s on a screen like a %s shows the stored picture", async (name, screen) => {
    const { page, errors } = still;
    await openExample(name, screen);
    await expect.poll(() => isStored(page, `${name.replace(/\.\w+$/, "")}-${screen}`), { timeout: 30_000, interval: 300 }).toBe(true).catch((error) => {
      expect(errors).toEqual([]);
      throw error;
    });
    expect(errors.filter((text) => !isOfOthers(text))).toEqual([]);
  });

  it("a picture without the learned light is told from the stored one", async () => {
    const { page } = still;
    await page.route("**/scene.glb", (route) => route.fulfill({ body: Buffer.from(writeGlb(furnishedRoom({ fields: [] }))) }));
    await openExample("three.html", "desktop");
    await page.waitForFunction(() => Number(document.body.dataset.frames) > 2);
    expect(await isStored(page, "three-desktop")).toBe(false);
    await page.unroute("**/scene.glb");
  });
});

/** @react-three/fiber 9 uses a clock and a kind of shadow map that three.js 0.187 warns of. */
const isOurs = (text: string) => !/^THREE\.(Clock|WebGLShadowMap): /.test(text);

describe("lightwell/react", () => {
  it("waits, draws under StrictMode, follows its group, frees everything, comes back, and hands errors to a boundary", async () => {
    const code = await bundle("pages/fiber.tsx", { development: true });
    const body = '<body data-src="/examples/web/scene.glb"><style>body{margin:0}</style><div id="root" style="width:200px;height:150px"></div>';
    extra.set("/fiber.html", ["text/html", modulePage(code, body)]);
    const { page, errors } = await openPage(browser, 200, 150);
    await page.goto(`${origin}/fiber.html`);
    const geometries = () => page.evaluate(() => (window as any).found.gl.info.memory.geometries as number);
    await page.waitForFunction(() => (window as any).found.gl?.info.memory.geometries > 5).catch(() => expect(errors).toEqual([]));
    await expect.poll(() => colours(page)).toBeGreaterThan(200);
    const state = await page.evaluate(() => {
      const { scene, waited } = (window as any).found;
      return { waited, lamp: scene.lamps[0].value.toArray() };
    });
    expect(state).toEqual({ waited: true, lamp: [0.3, 1.2, 0.2] });
    await page.evaluate(() => (window as any).show("/examples/web/scene.glb", [0, 0.4, 0]));
    await page.waitForFunction(() => (window as any).found.scene.root.matrixWorld.elements[13] === 0.4);
    await expect.poll(() => colours(page)).toBeGreaterThan(200);
    await page.evaluate(() => (window as any).show(null));
    await expect.poll(geometries).toBe(0);
    await page.evaluate(() => (window as any).show("/examples/web/scene.glb"));
    await expect.poll(geometries).toBeGreaterThan(5);
    await expect.poll(() => colours(page)).toBeGreaterThan(200);
    expect(errors.filter(isOurs)).toEqual([]);
    await page.evaluate(() => (window as any).show("/broken.glb"));
    await expect.poll(() => page.evaluate(() => (window as any).found.error)).toMatch(/version: expected 1/);
    await page.close();
  });
});

describe("what moves in lightwell/react", () => {
  it("has its short form, 0 to 1 of its range, beside values by name, lamps and a day", async () => {
    const code = await bundle("pages/fiber.tsx", { development: true });
    extra.set("/door.glb", ["model/gltf-binary", readFileSync(new URL("fixtures/field-and-probes.glb", import.meta.url))]);
    const body = '<body data-src="/door.glb"><style>body{margin:0}</style><div id="root" style="width:80px;height:60px"></div>';
    extra.set("/door.html", ["text/html", modulePage(code, body)]);
    const { page, errors } = await openPage(browser, 80, 60);
    await page.goto(`${origin}/door.html`);
    await page.waitForFunction(() => (window as any).found.scene?.movers.length === 1);
    const door = async (more: Record<string, unknown>) => {
      await page.evaluate((props) => (window as any).show("/door.glb", [0, 0, 0], props), more);
      return expect.poll(() => page.evaluate(() => (window as any).found.scene.movers[0].value as number));
    };
    await (await door({ movers: { Door: 20 } })).toBe(20);
    await (await door({ movers: { Door: 20 }, door: 0.5 })).toBe(45);
    await (await door({ door: 1 })).toBe(90);
    await (await door({})).toBe(await page.evaluate(() => (window as any).found.scene.movers[0].record.initial));
    // The group of three.js has no such property.
    await (await door({ door: 0.25 })).toBe(22.5);
    expect(await page.evaluate(() => "door" in (window as any).found.scene.root.parent)).toBe(false);
    expect(errors.filter(isOurs)).toEqual([]);
    // What is misspelled is said once; what a group has, is not.
    const said: string[] = [];
    page.on("console", (message) => void (message.type() === "warning" && said.push(message.text())));
    for (const dor of [0.1, 0.2]) await door({ dor, lamp: { desk: 0.3 }, movers: { Dor: 3 }, name: "room", "position-x": 0, userData: {} });
    const ours = () => said.filter((text) => text.startsWith("LearnedScene")).map((text) => text.split(" ")[1]);
    await expect.poll(() => ours().sort()).toEqual(["'Dor'", "'dor'", "'lamp'"]);
    await page.close();
  });
});

describe("<lightwell-viewer>", () => {
  it("loads without a build step, follows its attributes, and leaves nothing behind", async () => {
    const { page, errors } = await openPage(browser, 240, 180);
    await page.goto(`${origin}/examples/web/element.html`);
    await page.waitForFunction(() => (document.querySelector("lightwell-viewer") as any)?.scene);
    await expect.poll(() => colours(page)).toBeGreaterThan(200);
    const moved = await page.evaluate(() => {
      const viewer = document.querySelector("lightwell-viewer") as any;
      viewer.setAttribute("light", "0.4 0.9 0.1");
      viewer.setAttribute("camera", "0 1 3 / 0 1 0");
      viewer.setAttribute("exposure", "nonsense");
      return viewer.scene.lamps[0].value.toArray() as number[];
    });
    expect(moved).toEqual([0.4, 0.9, 0.1]);
    const left = await page.evaluate(async () => {
      const viewer = document.querySelector("lightwell-viewer") as any;
      const { scene } = viewer;
      viewer.remove();
      const gone = { scene: viewer.scene, parent: scene.root.parent };
      document.body.append(viewer);
      await new Promise((resolve) => viewer.addEventListener("load", resolve));
      return { gone, again: viewer.scene !== null && viewer.scene !== scene };
    });
    expect(left).toEqual({ gone: { scene: null, parent: null }, again: true });
    expect(errors).toEqual([]);
    await page.close();
  });

  it("says why a file cannot be shown, in the element and as an event", async () => {
    const { page } = await openPage(browser, 240, 180);
    await page.goto(`${origin}/examples/web/element.html`);
    for (const [src, text] of [["/broken.glb", "version: expected 1"], ["/nothing.glb", "404"]] as const) {
      const message = await page.evaluate(async (url) => {
        const viewer = document.querySelector("lightwell-viewer")!;
        const said = new Promise<string>((resolve) => viewer.addEventListener("error", (event) => resolve((event as ErrorEvent).message), { once: true }));
        viewer.setAttribute("src", url);
        return [await said, viewer.shadowRoot!.querySelector("p")!.textContent];
      }, src);
      expect(message[0]).toContain(text);
      expect(message[1]).toBe(message[0]);
    }
    await page.close();
  });
});
