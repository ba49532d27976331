/** Bundles a module as a consumer of the package would, and measures it. */

import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";
import { build } from "vite";
import { MODULES } from "../../modules.ts";

const here = (path: string): string => fileURLToPath(new URL(path, import.meta.url));

/** A file of a bundle. */
export interface Chunk {
  readonly fileName: string;
  readonly code: string;
  /** Files that it imports at once. */
  readonly imports: readonly string[];
  /** Files that it loads when they are needed. */
  readonly dynamicImports: readonly string[];
  readonly isEntry: boolean;
}

export interface BundleOptions {
  /** Leave these out: what the page brings along. */
  readonly external?: readonly RegExp[];
  /** Package to take for three.js: another version under another name. */
  readonly three?: string;
  /** Take the development build of React, whose StrictMode mounts everything twice. */
  readonly development?: boolean;
}

/** What was bundled in this process, by entry and options: several files open the same page, and a bundle takes half a second. */
const made = new Map<string, Promise<string>>();

/** One minified module made of an entry (a path from `test/`) or of a text of imports. */
export function bundle(entry: string, options: BundleOptions = {}): Promise<string> {
  const key = JSON.stringify([entry, { ...options, external: options.external?.map(String) }]);
  const found = made.get(key) ?? bundleChunks(entry, options, false).then((chunks) => chunks.map((chunk) => chunk.code ?? "").join("\n"));
  made.set(key, found);
  return found;
}

/** The same as several files where `split`: what is loaded on demand is apart. */
export async function bundleChunks(entry: string, { external = [], three, development = false }: BundleOptions = {}, split = true): Promise<readonly Chunk[]> {
  const folder = mkdtempSync(join(tmpdir(), "lightwell-bundle-"));
  const isText = /[\s;]/.test(entry);
  const id = isText ? join(folder, "entry.tsx") : here(`../${entry}`);
  if (isText) writeFileSync(id, entry);
  const result = await build({
    configFile: false,
    mode: "production",
    // Tests run as "test", which React takes for development.
    oxc: { jsx: { development: false } },
    logLevel: "error",
    root: here("../.."),
    resolve: {
      alias: [
        ...Object.entries(MODULES).map(([name, path]) => ({ find: new RegExp(`^${name}$`), replacement: path })),
        ...(three ? [{ find: /^three(?=$|\/)/, replacement: three }] : []),
      ],
    },
    define: { "process.env.NODE_ENV": development ? '"development"' : '"production"' },
    plugins: [
      {
        // Examples lie outside of this folder, and temporary files too: their packages are those that are here.
        name: "packages",
        resolveId(source, importer) {
          const outside = importer && !importer.startsWith(here("../..")) && /^[@a-z]/.test(source);
          return outside ? this.resolve(source, here("../../modules.ts"), { skipSelf: true }) : null;
        },
      },
    ],
    build: {
      write: false,
      target: "es2022",
      minify: true,
      modulePreload: false,
      // An app, not a library: a library build keeps white space.
      rollupOptions: {
        input: id,
        external: [...external],
        preserveEntrySignatures: "strict",
        output: { format: "es", codeSplitting: split },
      },
    },
  });
  rmSync(folder, { recursive: true });
  return ((Array.isArray(result) ? result[0] : result) as { output: Chunk[] }).output;
}

/** What the package is not: three.js and the libraries of other worlds. */
export const NOT_OURS = [/^three($|\/)/, /^@gltf-transform\//, /^@babylonjs\//, /^playcanvas($|\/)/, /^@react-three\//, /^react/];

/** Bytes of a bundle as a server would send it. */
export const gzipped = (code: string): number => gzipSync(code, { level: 9 }).length;

/** A page that runs a module. */
export function modulePage(code: string, body = ""): string {
  return `<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">${body}<script type="module">${code.replaceAll("</script", "<\\/script")}</script>`;
}
