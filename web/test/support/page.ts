/** Puts data into the built page as a bake does. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";

export const BUILT_PAGE = fileURLToPath(new URL("../../../lightwell/viewer/index.html", import.meta.url));

const PLACE = "<!--lightwell-data-->";

/** The page with an asset and page data. */
export function pageWith(glb: Uint8Array, page?: unknown): string {
  const asset = `<script type="application/octet-stream;base64" id="lightwell-asset">${Buffer.from(glb).toString("base64")}</script>`;
  // `<` cannot end a script early when it is escaped.
  const json = JSON.stringify(page ?? {}).replaceAll("<", "\\u003c");
  const data = `${asset}<script type="application/json" id="lightwell-page">${json}</script>`;
  return readFileSync(BUILT_PAGE, "utf8").replace(PLACE, () => data);
}

/** A reference as page data carries it; `pixels` are RGB half-float bits, first row at the top. */
export function packReference(pixels: Uint16Array): string {
  return gzipSync(Buffer.from(pixels.buffer, pixels.byteOffset, pixels.byteLength)).toString("base64");
}
