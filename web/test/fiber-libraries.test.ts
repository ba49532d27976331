/** `lightwell/react` together with drei and @react-three/postprocessing, under StrictMode and Suspense. */

import type { Browser, Page } from "playwright-core";
import { afterAll, afterEach, beforeAll, expect, it } from "vitest";
import type { Setting } from "./pages/fiber-libraries.tsx";
import { launch, openPage, Site } from "./support/browser.ts";
import { bundle, modulePage } from "./support/bundle.ts";
import { furnishedRoom } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";
import { type Likeness, likenessOf } from "./support/stored-picture.ts";

const [WIDTH, HEIGHT] = [160, 120];
/** Effects carry the picture in half floats: what they round lies well below this. */
const ALIKE = { mean: 0.005, off: 0.01 };
const HOME: Place = [0, 1, 4.2];
const EVERYTHING = { src: "/scene.glb", controls: true, environment: "lamp", effects: "curve" } as const;

type Place = [number, number, number];

let browser: Browser;
let page: Page;
let errors: string[];
/** What plain three.js draws from where the camera begins. */
let home: Buffer;
const site = new Site();

beforeAll(async () => {
  await site.open();
  browser = await launch("llvmpipe");
  ({ page, errors } = await openPage(browser, WIDTH, HEIGHT));
  site.put("/scene.glb", writeGlb(furnishedRoom()));
  site.put("/unlit.glb", writeGlb(furnishedRoom({ fields: [] })));
  site.put("/sky.hdr", whiteSky(), { "access-control-allow-origin": "*" });
  const body = `<body><style>body { margin: 0; overflow: hidden }</style><div id="root" style="width: ${WIDTH}px; height: ${HEIGHT}px"></div>`;
  await page.goto(site.put("/index.html", modulePage(await bundle("pages/fiber-libraries.tsx", { development: true }), body)));
  await page.waitForFunction(() => window.fiber).catch(() => expect(errors).toEqual([]));
  home = await plain(HOME);
}, 120_000);

/** @react-three/fiber 9 uses a clock and a kind of shadow map that three.js 0.187 warns of. */
const isOfOthers = (text: string) => /^THREE\.(Clock|WebGLShadowMap): /.test(text);

afterEach(async () => {
  // Every test begins with a canvas of its own.
  await page.evaluate(() => window.fiber.leave());
  expect(errors.splice(0).filter((text) => !isOfOthers(text))).toEqual([]);
});

afterAll(async () => {
  await browser?.close();
  await site.close();
});

/** A Radiance picture of one colour; rows of fewer than eight pixels have no run lengths. */
function whiteSky(): Uint8Array {
  const [width, height] = [4, 2];
  // 128 · 2^(129 − 136) = 1.
  const pixels = Array.from({ length: width * height }, () => [128, 128, 128, 129]).flat();
  return Buffer.concat([Buffer.from(`#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y ${height} +X ${width}\n`), Buffer.from(pixels)]);
}

const show = (setting: Setting) => page.evaluate((given) => window.fiber.show(given), setting);

async function plain(position: Place): Promise<Buffer> {
  await page.evaluate((place) => window.fiber.showPlain("/scene.glb", place), position);
  return page.screenshot();
}

const likeness = async (picture: Buffer): Promise<Likeness> => likenessOf(page, await page.screenshot(), picture);
const isLike = ({ mean, off }: Likeness) => mean < ALIKE.mean && off < ALIKE.off;

/** Wait for the canvas to show a picture. */
async function expectPicture(picture: Buffer): Promise<void> {
  const last = { current: {} as Likeness };
  await expect
    .poll(async () => isLike((last.current = await likeness(picture))), { timeout: 20_000, interval: 200 })
    .toBe(true)
    .catch(() => expect({ ...last.current, errors: errors.filter((text) => !isOfOthers(text)) }).toEqual({ ...ALIKE, errors: [] }));
}

/** Mean of all channels of the canvas, 0 to 1, and the mean distance of its colours from grey. */
async function colours(): Promise<{ mean: number; chroma: number }> {
  return page.evaluate(async (text) => {
    const image = await createImageBitmap(new Blob([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))]));
    const context = new OffscreenCanvas(image.width, image.height).getContext("2d")!;
    context.drawImage(image, 0, 0);
    const { data } = context.getImageData(0, 0, image.width, image.height);
    let [sum, chroma] = [0, 0];
    for (let i = 0; i < data.length; i += 4) {
      const [r, g, b] = [data[i]!, data[i + 1]!, data[i + 2]!];
      sum += (r + g + b) / 3 / 255;
      chroma += (Math.max(r, g, b) - Math.min(r, g, b)) / 255;
    }
    return { mean: (4 * sum) / data.length, chroma: (4 * chroma) / data.length };
  }, (await page.screenshot()).toString("base64"));
}

const memory = () => page.evaluate(() => ({ ...window.fiber.found.gl!.info.memory }));

it("is the picture of plain three.js beside controls, an environment and effects, and waits for its file", async () => {
  await show(EVERYTHING);
  await expectPicture(home);
  const { waited, effects } = await page.evaluate(() => window.fiber.found);
  expect(waited).toBe(true);
  // StrictMode mounts everything twice.
  expect(effects).toBe(2);
  // The learned light is a part of the picture.
  await show({ ...EVERYTHING, src: "/unlit.glb" });
  await page.waitForFunction(() => window.fiber.found.scene?.fields.length === 0);
  await expect.poll(async () => (await likeness(home)).mean).toBeGreaterThan(4 * ALIKE.mean);
});

it.each(["lamp", "file"] as const)("the light of an environment that is a %s is added where it is asked for", async (environment) => {
  await show({ ...EVERYTHING, environment });
  await page.waitForFunction(() => window.fiber.found.world?.environment);
  await expectPicture(home);
  const without = await colours();
  await show({ ...EVERYTHING, environment, policy: "keep" });
  await expect.poll(async () => (await colours()).mean).toBeGreaterThan(without.mean + 0.05);
  await show(EVERYTHING);
  await expectPicture(home);
});

it("effects see the learned light", async () => {
  await show({ ...EVERYTHING, effects: "grey" });
  await expect.poll(async () => (await colours()).chroma).toBeLessThan(0.005);
  expect((await colours()).mean).toBeGreaterThan(0.2);
  await show(EVERYTHING);
  await expectPicture(home);
});

it.each(["always", "demand"] as const)("the visitor orbits, and the light moves, where frames are drawn %s", async (frameloop) => {
  await show({ ...EVERYTHING, frameloop });
  await expectPicture(home);
  await page.mouse.move(80, 60);
  await page.mouse.down();
  await page.mouse.move(60, 70, { steps: 4 });
  await page.mouse.up();
  await expect.poll(async () => (await likeness(home)).mean).toBeGreaterThan(4 * ALIKE.mean);
  const place = await page.evaluate(() => window.fiber.found.camera!.position.toArray());
  const reference = await plain(place);
  await show({ ...EVERYTHING, frameloop });
  await expectPicture(reference);
  await show({ ...EVERYTHING, frameloop, light: [-0.6, 0.4, 0.6] });
  await expect.poll(async () => (await likeness(reference)).mean).toBeGreaterThan(4 * ALIKE.mean);
});

it("gives the model back and frees it when it is taken away, and comes back", async () => {
  const rest: Setting = { ...EVERYTHING, src: undefined };
  const state = () => page.evaluate(() => window.fiber.stateOf((window as any).model));
  const asLoaded = { patched: 0, sides: 0, lights: 0, shadows: 0 };
  const left: { geometries: number; textures: number }[] = [];
  for (let round = 0; round < 4; round++) {
    await show(EVERYTHING);
    await expectPicture(home);
    await page.evaluate(() => Object.assign(window, { model: window.fiber.found.scene!.root }));
    expect(await state()).toEqual({ patched: 4, sides: 4, lights: 1, shadows: expect.any(Number) });
    const { geometries } = await memory();
    await show(rest);
    await expect.poll(state).toEqual(asLoaded);
    await expect.poll(async () => (await memory()).geometries).toBeLessThan(geometries - 5);
    left.push(await memory());
  }
  expect(new Set(left.map(({ geometries }) => geometries)).size).toBe(1);
  // A frame without a shadow map has three.js' empty one, once for all rounds.
  expect(left[3]!.textures - left[0]!.textures).toBeLessThanOrEqual(1);
  await show(EVERYTHING);
  await expectPicture(home);
  await page.evaluate(() => window.fiber.leave());
  await expect.poll(state).toEqual(asLoaded);
});
