/** Both renderers of three.js show the same learned light, the closed form's, and nothing is left when it is disposed of. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, describe, expect, it } from "vitest";
import type { Answer, Request } from "./pages/renderers.ts";
import { type Backend, launch, openPage, Site } from "./support/browser.ts";
import { bundle, modulePage } from "./support/bundle.ts";
import { CAMERA, LAMP, linearField, linearRadiance, plainRoom, stillField, STILL, WHITE } from "./support/fixtures.ts";
import { type Fixture, writeGlb } from "./support/glb.ts";
import { backWallPoint } from "./support/optics.ts";

const [WIDTH, HEIGHT] = [96, 72];
const REFLECTANCE = WHITE[0] + 0.04;
const EYE = { position: CAMERA.position, target: CAMERA.target, fovY: CAMERA.fov_y } as Request["camera"];
const LIGHTMAP = readFileSync(fileURLToPath(new URL("fixtures/lightmap.glb", import.meta.url)));

const base64 = (bytes: Uint8Array) => Buffer.from(bytes).toString("base64");

let code = "";
beforeAll(async () => {
  code = await bundle("pages/renderers.ts");
});

/** What each launch can run. */
const CASES: [Backend, Request["kind"]][] = [
  ["swiftshader", "webgl"],
  ["swiftshader", "webgpu"],
  ["swiftshader", "fallback"],
  ["llvmpipe", "webgl"],
];

describe.each([...new Set(CASES.map(([backend]) => backend))])("on %s", (backend) => {
  let browser: Browser;
  let page: Page;
  let errors: string[];
  const site = new Site();

  beforeAll(async () => {
    await site.open();
    browser = await launch(backend);
    ({ page, errors } = await openPage(browser));
    await page.goto(site.put("/index.html", modulePage(code)));
    await page.waitForFunction(() => window.ready);
  }, 90_000);

  afterAll(async () => {
    await browser?.close();
    await site.close();
    expect(errors).toEqual([]);
  });

  const draw = (kind: Request["kind"], glb: Uint8Array, change: Partial<Request> = {}): Promise<Answer> =>
    page.evaluate((request) => window.draw(request), {
      glb: base64(glb),
      kind,
      width: WIDTH,
      height: HEIGHT,
      camera: EYE,
      ...change,
    });
  const room = (change: Partial<Fixture> = {}) => writeGlb(plainRoom(change));
  const kinds = CASES.filter(([name]) => name === backend).map(([, kind]) => kind);

  it.each(kinds)("%s: adds reflectance · field · colour · intensity, and frees what it made", async (kind) => {
    for (const weights of ["inline", "texture"] as const) {
      const { data, backend: found, memory } = await draw(kind, room({ fields: [linearField(), stillField()] }), { weights });
      expect(found).toBe(kind === "webgpu" ? "webgpu" : "webgl");
      for (let y = 20; y < 52; y += 8) {
        for (let x = 34; x < 62; x += 7) {
          const field = linearRadiance(backWallPoint(x, y, WIDTH, HEIGHT, -1), LAMP.initial);
          field.forEach((value, c) => {
            const expected = REFLECTANCE * (value * LAMP.color[c]! * LAMP.intensity + STILL[c]!);
            expect(Math.abs(data[4 * (y * WIDTH + x) + c]! / expected - 1)).toBeLessThan(2e-3);
          });
        }
      }
      const [before, there, after] = memory;
      expect(after).toEqual(before);
      expect(there!.geometries).toBeGreaterThan(before!.geometries);
    }
  });

  it.each(kinds)("%s: samples pictures, the way up and the colours that they were written in", async (kind) => {
    const camera = { position: [0.4, 1.1, 2.6], target: [0, 0.7, -0.4], fovY: 45 } as Request["camera"];
    const { data, memory } = await draw(kind, LIGHTMAP, { camera });
    const reference = await draw("webgl", LIGHTMAP, { camera, weights: "texture" });
    const covered = data.filter((_, i) => i % 4 === 3 && data[i]! > 0).length;
    expect(covered).toBeGreaterThan(0.2 * WIDTH * HEIGHT);
    let worst = 0;
    for (let i = 0; i < data.length; i++) {
      const [x, y] = [(i >> 2) % WIDTH, Math.floor((i >> 2) / WIDTH)];
      // Where the two squares meet and end, renderers may disagree on who owns a pixel.
      if (x < 2 || y < 2 || reference.data[i]! === 0 || data[i] === 0) continue;
      worst = Math.max(worst, Math.abs(data[i]! - reference.data[i]!) / Math.max(0.05, reference.data[i]!));
    }
    expect(worst).toBeLessThan(0.05);
    expect(memory[2]).toEqual(memory[0]);
    expect(memory[1]!.textures).toBeGreaterThanOrEqual(memory[0]!.textures + 2);
  });
});
