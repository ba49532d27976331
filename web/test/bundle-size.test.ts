/** What the package weighs in a page that has three.js already; written to `test-results/bundle.json` for the benchmarks. */

import { mkdirSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { expect, it } from "vitest";
import { bundle, bundleChunks, type Chunk, gzipped, NOT_OURS } from "./support/bundle.ts";

/** Gzipped bytes, without three.js, that a page fetches before it has a file, by what it imports. */
const AT_ONCE = { loader: 12_000, typical: 30_000, webgpu: 30_300 } as const;
/** Together with what is loaded for a file with a field of common ops. */
const WITH_FIELD = { loader: 22_300, typical: 39_700, webgpu: 40_300 } as const;
/** What most pages never fetch: a chunk for each rare op, for what those share, and for what few fields have. */
const RARE_OPS = readdirSync(new URL("../runtime/src/graph/ops/rare", import.meta.url)).map((file) => file.replace(".ts", ""));
const RARE = new RegExp(`^(${[...RARE_OPS, "interpolated-table", "half-resolution", "half-nodes", "half-target", "segments", "segment-nodes", "segment-colors", "movers", "lamp-clips", "lit-objects", "environment-picture", "turning-lamp"].join("|")})-`);
/** The runtime as one module, with everything that is otherwise loaded on demand. */
const LIMIT = 48_800;

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

const GUIDE = readFileSync(new URL("../../docs/web.md", import.meta.url), "utf8");
/** How the guide calls what is imported. */
const NAMES = { loader: "`LightwellLoaderPlugin`", typical: "with `LearnedScene`", webgpu: "with `LearnedNodeScene`" } as const;

/** Kilobytes that the guide gives for an import: at once, and with a file that has a field. */
function documented(name: keyof typeof NAMES): number[] {
  const row = GUIDE.split("\n").find((line) => line.startsWith(`| ${NAMES[name]}`))!;
  return [...row.matchAll(/([\d.]+) kB/g)].map((match) => Number(match[1]));
}

/** The entry and what it imports at once; with what it loads for a common file where `loaded`. */
function fetched(chunks: readonly Chunk[], loaded: boolean): Chunk[] {
  const byName = new Map(chunks.map((chunk) => [chunk.fileName, chunk]));
  const found = new Set(chunks.filter(({ isEntry }) => isEntry));
  for (const { imports, dynamicImports } of found) {
    const next = loaded ? [...imports, ...dynamicImports] : imports;
    for (const name of next) {
      const chunk = byName.get(name);
      if (chunk && !RARE.test(name.split("/").at(-1)!)) found.add(chunk);
    }
  }
  return [...found];
}

const together = (chunks: readonly Chunk[]) => ({
  bytes: chunks.reduce((sum, { code }) => sum + code.length, 0),
  gzipped: chunks.reduce((sum, { code }) => sum + gzipped(code), 0),
});

const sizes: Record<string, { bytes: number; gzipped: number }> = {};

it.each(Object.keys(AT_ONCE) as (keyof typeof AT_ONCE)[])("%s: what a page fetches at once is small, the rest waits for a file that needs it", async (name) => {
  const chunks = await bundleChunks(CASES[name], { external: NOT_OURS });
  sizes[`${name} at once`] = together(fetched(chunks, false));
  sizes[`${name} with a field`] = together(fetched(chunks, true));
  expect(sizes[`${name} at once`]!.gzipped).toBeLessThanOrEqual(AT_ONCE[name]);
  expect(sizes[`${name} with a field`]!.gzipped).toBeLessThanOrEqual(WITH_FIELD[name]);
  const found = [sizes[`${name} at once`]!, sizes[`${name} with a field`]!].map((size) => size.gzipped / 1000);
  documented(name).forEach((kilobytes, i) => expect(Math.abs(found[i]! / kilobytes - 1)).toBeLessThan(0.05));
  expect(documented(name)).toHaveLength(2);
  expect(fetched(chunks, true).length).toBeGreaterThan(fetched(chunks, false).length);
});

it("is small enough, and what is not used stays away", async () => {
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
  expect(sizes["lens-three"]!.gzipped).toBeLessThan(18_500);
  expect(sizes["gltf-transform"]!.gzipped).toBeLessThan(6_000);
});
