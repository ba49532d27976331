/** A light map in KTX2 pictures: what the GPU reads is what Python decoded, from which the network was trained and scored. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { LinearFilter, LinearMipmapLinearFilter, RGBAFormat } from "three";
import { expect, it } from "vitest";
import { launch, openPage, Site } from "./support/browser.ts";
import { bundleChunks, modulePage } from "./support/bundle.ts";

/** Made by `python tools/lightmap_example.py lightmap-ktx2.glb --ktx2`. */
const fixture = (name: string) => readFileSync(fileURLToPath(new URL(`fixtures/${name}`, import.meta.url)));
const GLB = fixture("lightmap-ktx2.glb").toString("base64");
const TEXELS: Record<string, number[][][][]> = JSON.parse(fixture("lightmap-ktx2.json").toString()).texels;
/** BC7 of UASTC differs from what UASTC decodes to by a few bytes' steps. */
const [LARGEST, MEAN] = [6, 1];

/** Differences of the red, green and blue of RGBA texels from those expected. */
function differences(found: number[], expected: number[][][]): number[] {
  const rgb = expected.flat(2);
  expect(found.length).toBe((4 * rgb.length) / 3);
  return rgb.map((value, i) => Math.abs(value - found[4 * Math.floor(i / 3) + (i % 3)]!));
}

it("fetches features exactly as decoded, and blocks within their error", async () => {
  const site = new Site();
  await site.open();
  const browser = await launch("swiftshader");
  const { page, errors } = await openPage(browser, 32, 32);
  const files = (await bundleChunks("pages/ktx2.ts", {}, false)) as readonly { fileName: string; code?: string; source?: Uint8Array }[];
  // three's decoder is two files beside the bundle.
  for (const { fileName, source } of files) if (source) site.put(`/${fileName}`, source);
  const url = site.put("/ktx2.html", modulePage(files.map(({ code }) => code ?? "").join("\n")));
  // A page for each: a decoder belongs to a renderer, and three warns of two.
  const read = async (compressed: boolean) => {
    await page.goto(url);
    return page.evaluate(([glb, blocks]) => window.picturesOf(glb, blocks), [GLB, compressed] as const);
  };
  const [plain, blocks] = [await read(false), await read(true)];
  const refused = await page.evaluate((glb) => window.withoutDecoder(glb), GLB);
  await browser.close();
  await site.close();
  expect(errors).toEqual([]);
  expect(Object.keys(plain).sort()).toEqual(Object.keys(TEXELS).sort());
  for (const [name, levels] of Object.entries(TEXELS)) {
    expect(plain[name]!.levels.length).toBe(levels.length);
    for (const [level, expected] of levels.entries()) {
      expect(Math.max(...differences(plain[name]!.levels[level]!, expected))).toBe(0);
      const off = differences(blocks[name]!.levels[level]!, expected);
      expect(Math.max(...off)).toBeLessThanOrEqual(LARGEST);
      expect(off.reduce((sum, value) => sum + value, 0) / off.length).toBeLessThan(MEAN);
    }
    expect(blocks[name]!.minFilter).toBe(levels.length > 1 ? LinearMipmapLinearFilter : LinearFilter);
    expect(plain[name]!.format).toBe(RGBAFormat);
    expect(blocks[name]!.format).not.toBe(RGBAFormat);
  }
  // Features of random bytes: a picture that is turned over is found.
  expect(Math.max(...differences([...plain.f0!.levels[0]!].reverse(), TEXELS.f0![0]!))).toBeGreaterThan(LARGEST);
  expect(refused).toMatch(/^textures\[\d\]: expected a decoder of its KTX2 picture, found none; pass \{ renderer \}/);
  expect(refused).not.toContain("\n");
});
