/**
 * Times of the page, for benchmarks/web.py on a machine that does nothing else: a frame with a field of a thousand multiply-adds over
 * one with a plain light map, and the first picture of a page (`LIGHTWELL_FIRST_PICTURE`: a file that a bake wrote). Runs where
 * figures are measured alone (vitest.config.ts).
 */

import { readFileSync } from "node:fs";
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, expect, it } from "vitest";
import { type Backend, launch, openPage, Site } from "./support/browser.ts";
import { keepFigure } from "./support/figures.ts";
import { CAMERA, furnishedRoom } from "./support/fixtures.ts";
import { type FixtureField, writeGlb } from "./support/glb.ts";
import { pageWith } from "./support/page.ts";

const [WIDTH, HEIGHT] = [640, 400];
/** Widths of a network with about a thousand multiply-adds: position and light to radiance. */
const WIDTHS = [6, 25, 30, 3];
/** Frames of a measurement, and measurements of each kind: the median counts. */
const [FRAMES, ROUNDS] = [5, 7];
const OPENINGS = 5;

const site = new Site();
let browser: Browser | undefined;

beforeAll(() => site.open());
afterAll(() => site.close());

const median = (values: readonly number[]): number => [...values].sort((a, b) => a - b)[values.length >> 1]!;

function network(): FixtureField {
  const layers = WIDTHS.slice(1).map((rows, i) => ({ rows, columns: WIDTHS[i]!, last: i === WIDTHS.length - 2 }));
  const weight = (k: number) => 0.3 * Math.sin(1.7 * k + 1);
  const buffers = layers.flatMap(({ rows, columns }, i) => [
    [`w${i}`, { shape: [rows, columns], type: "float32" as const, values: Float32Array.from({ length: rows * columns }, (_, k) => weight(k)) }] as const,
    [`b${i}`, { shape: [rows], type: "float32" as const, values: Float32Array.from({ length: rows }, (_, k) => 0.1 + weight(k)) }] as const,
  ]);
  const nodes = layers.flatMap(({ last }, i) => [
    { id: `l${i}`, op: "linear", inputs: [i ? `a${i - 1}` : "x"], weights: `w${i}`, bias: `b${i}` },
    ...(last ? [] : [{ id: `a${i}`, op: "activate", inputs: [`l${i}`], function: "relu" }]),
  ]);
  const graph = {
    version: 1,
    inputs: { position: 3, light: 3 },
    buffers: Object.fromEntries(buffers),
    nodes: [{ id: "x", op: "concat", inputs: ["position", "light"] }, ...nodes],
    outputs: { radiance: `l${layers.length - 1}` },
  };
  return { name: "indirect", role: "indirect", variable: 0, graph };
}

/** The furnished room with this network, and with a plain light map on every surface. */
function room(): Uint8Array {
  const fixture = furnishedRoom({ fields: [network()] });
  const meshes = fixture.meshes.map((mesh) => ({ ...mesh, uv: mesh.positions.filter((_, i) => i % 3 < 2).map((x) => x / 2 + 0.5) }));
  const picture = readFileSync(new URL("pictures/three-desktop.png", import.meta.url)).toString("base64");
  return writeGlb({
    ...fixture,
    meshes,
    tamper: (json: any) => {
      json.images = [{ uri: `data:image/png;base64,${picture}` }];
      json.textures = [{ source: 0 }];
      json.extensionsUsed.push("MOZ_lightmap");
      for (const material of json.materials) material.extensions = { ...material.extensions, MOZ_lightmap: { index: 0, texCoord: 0, intensity: 1 } };
    },
  });
}

async function withBrowser<T>(backend: Backend, work: (opened: Browser) => Promise<T>): Promise<T> {
  browser = await launch(backend);
  try {
    return await work(browser);
  } finally {
    await browser.close();
  }
}

it.each(["swiftshader", "llvmpipe"] as const)("a frame with a field over one with a plain light map on %s", async (backend) => {
  const address = `${site.put("/room.html", pageWith(room(), { title: "Room", home: CAMERA }))}?size=${WIDTH}x${HEIGHT}&ui=0&samples=0`;
  const { learned, lightmap, macs } = await withBrowser(backend, async (opened) => {
    const { page } = await openPage(opened, WIDTH, HEIGHT);
    await page.goto(address);
    return page.evaluate(
      async ([frames, rounds]) => {
        const { lightwell } = window;
        await lightwell.ready;
        const found = { learned: [] as number[], lightmap: [] as number[] };
        for (let round = 0; round < rounds; round++) {
          for (const mode of ["learned", "lightmap"] as const) {
            await lightwell.setMode(mode);
            lightwell.measure(1);
            found[mode].push(lightwell.measure(frames));
          }
        }
        return { ...found, macs: lightwell.stats().macs };
      },
      [FRAMES, ROUNDS] as const,
    );
  });
  expect(macs).toBeGreaterThan(950);
  expect(macs).toBeLessThan(1050);
  const ratio = median(learned.map((milliseconds, i) => milliseconds / lightmap[i]!));
  keepFigure(`field over light map on ${backend}`, ratio);
  expect(ratio).toBeGreaterThan(0.5);
}, 600_000);

it.skipIf(!process.env.LIGHTWELL_FIRST_PICTURE)("the first picture of a page on SwiftShader, learned light included", async () => {
  const address = site.put("/page.html", readFileSync(process.env.LIGHTWELL_FIRST_PICTURE!, "utf8"));
  const seconds: number[] = [];
  await withBrowser("swiftshader", async (opened) => {
    for (let i = 0; i < OPENINGS; i++) {
      const { page, errors } = await openPage(opened, WIDTH, HEIGHT);
      await page.goto(address);
      seconds.push(await page.evaluate(() => window.lightwell.ready.then(() => performance.now() / 1000)));
      expect(errors).toEqual([]);
      await page.close();
    }
  });
  // The first opening starts the browser's processes too.
  keepFigure("first picture, s", median(seconds));
  expect(Math.min(...seconds)).toBeGreaterThan(0.05);
}, 600_000);
