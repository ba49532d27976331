/** What the package weighs in a page that has three.js already; written to `test-results/bundle.json` for the benchmarks. */

import { mkdirSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { expect, it } from "vitest";
import { bundle, gzipped, NOT_OURS } from "./support/bundle.ts";

/** The runtime without three.js, gzipped. */
const LIMIT = 34_500;

const CASES = {
  everything: 'export * from "lightwell";',
  typical: 'export { LearnedScene, LightwellLoaderPlugin } from "lightwell";',
  loader: 'export { LightwellLoaderPlugin } from "lightwell";',
  webgpu: 'export { LearnedNodeScene, LightwellLoaderPlugin } from "lightwell/webgpu";',
  element: 'export { LightwellViewer } from "lightwell/element";',
  "gltf-transform": 'export * from "lightwell/gltf-transform";',
  export: 'export * from "lightwell/export";',
  lens: 'export { Lens, readLibrary } from "lightwell/lens";',
  "lens-three": 'export { LensNode } from "lightwell/lens/three"; export { readLibrary } from "lightwell/lens";',
};

it("is small enough, and what is not used stays away", async () => {
  const sizes: Record<string, { bytes: number; gzipped: number }> = {};
  for (const [name, text] of Object.entries(CASES)) {
    const code = await bundle(text, { external: NOT_OURS });
    expect(code).not.toContain("WebGLRenderer requires");
    sizes[name] = { bytes: code.length, gzipped: gzipped(code) };
    if (name === "typical") expect(code).not.toMatch(/gltf-transform|textureSampleLevel|mainImage|customElements|lightwell-spreadlets/);
  }
  const folder = fileURLToPath(new URL("../test-results/", import.meta.url));
  mkdirSync(folder, { recursive: true });
  writeFileSync(`${folder}bundle.json`, `${JSON.stringify({ limit: LIMIT, sizes }, null, 1)}\n`);
  expect(sizes.everything!.gzipped).toBeLessThanOrEqual(LIMIT);
  expect(sizes.typical!.gzipped).toBeLessThanOrEqual(LIMIT);
  expect(sizes.webgpu!.gzipped).toBeLessThanOrEqual(LIMIT);
  expect(sizes["lens-three"]!.gzipped).toBeLessThan(18_000);
  expect(sizes["gltf-transform"]!.gzipped).toBeLessThan(6_000);
});
