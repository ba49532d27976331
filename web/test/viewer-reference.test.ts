/** The page's decoder of path-traced pictures, on a picture that the bake's encoder packed (tests/asset/test_asset_page.py keeps it fresh). */

import { readFileSync } from "node:fs";
import { DataUtils } from "three";
import { describe, expect, it } from "vitest";
import { readPageData } from "../viewer/src/page-data.ts";
import { decodeReference } from "../viewer/src/reference.ts";
import { packReference } from "./support/page.ts";

const stored = JSON.parse(readFileSync(new URL("fixtures/reference.json", import.meta.url), "utf8"));

/** The view as the page reads it. */
function viewOf(packed: object) {
  const camera = { position: [0, 0, 1], target: [0, 0, 0] };
  return readPageData({ views: [{ camera, width: stored.width, height: stored.height, ...packed }] }).views[0]!;
}

describe("a reference of the page", () => {
  it.each([
    ["packed by a bake", stored],
    ["packed by the tests", packReference(stored.radiance, stored.width)],
  ])("%s is decoded to a third of a per cent", async (_, packed) => {
    const view = viewOf(packed);
    const texture = await decodeReference(view);
    const rgba = texture.image.data as unknown as Uint16Array;
    stored.radiance.forEach((value: number, i: number) => {
      const shown = DataUtils.fromHalfFloat(rgba[4 * Math.floor(i / 3) + (i % 3)]!);
      const truth = Math.min(value, 65504);
      expect(Math.abs(shown - truth), `number ${i}`).toBeLessThan(0.0035 * (truth + view.dark));
    });
    texture.dispose();
  });

  it("is refused when it has another size, and left out without its scale", async () => {
    await expect(decodeReference({ ...viewOf(stored), height: stored.height + 1 })).rejects.toThrow("reference: expected 252 bytes, found 210");
    await expect(decodeReference({ ...viewOf(stored), height: stored.height - 1 })).rejects.toThrow("reference: more than the expected 168 bytes");
    expect(viewOf({ ...stored, dark: 0 }).reference).toBe("");
  });
});
