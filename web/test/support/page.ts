/** Puts data into the built page as a bake does. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";

export const BUILT_PAGE = fileURLToPath(new URL("../../../lightwell/viewer/index.html", import.meta.url));

const PLACE = "<!--lightwell-data-->";

/** The page with an asset and page data. */
export function pageWith(glb: Uint8Array, page?: unknown): string {
  const packed = gzipSync(glb).toString("base64");
  const asset = `<script type="application/gzip;base64" data-bytes="${glb.length}" id="lightwell-asset">${packed}</script>`;
  // `<` cannot end a script early when it is escaped.
  const json = JSON.stringify(page ?? {}).replaceAll("<", "\\u003c");
  const data = `${asset}<script type="application/json" id="lightwell-page">${json}</script>`;
  return readFileSync(BUILT_PAGE, "utf8").replace(PLACE, () => data);
}

/** Radiance below which the steps of `packReference` are even, and steps in a factor of two (format/FORMAT.md, "The page data"). */
const DARK = 0.01;
const STEPS = 128;

/** A reference as page data carries it; `radiance` has three numbers for each pixel, first row at the top. */
export function packReference(radiance: ArrayLike<number>, width: number): { dark: number; reference: string } {
  const codes = Array.from(radiance, (value) => Math.round(STEPS * Math.log2(1 + value / DARK)));
  const texels = codes.length / 3;
  const planes = [(i: number) => codes[3 * i + 1]!, (i: number) => codes[3 * i]! - codes[3 * i + 1]!, (i: number) => codes[3 * i + 2]! - codes[3 * i + 1]!];
  const bytes = new Uint8Array(6 * texels);
  for (let at = 0; at < 3 * texels; at++) {
    const [i, code] = [at % texels, planes[Math.floor(at / texels)]!];
    const [column, row] = [i % width, Math.floor(i / width)];
    const [left, above, corner] = [column ? code(i - 1) : 0, row ? code(i - width) : 0, column && row ? code(i - width - 1) : 0];
    const [low, high] = [Math.min(left, above), Math.max(left, above)];
    const rest = code(i) - (corner >= high ? low : corner <= low ? high : left + above - corner);
    const folded = rest < 0 ? -2 * rest - 1 : 2 * rest;
    bytes[at] = folded >> 8;
    bytes[3 * texels + at] = folded & 255;
  }
  return { dark: DARK, reference: gzipSync(bytes).toString("base64") };
}
