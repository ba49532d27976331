import { fileURLToPath } from "node:url";
import { defineConfig } from "vite";
import { viteSingleFile } from "vite-plugin-singlefile";
import { MODULES } from "./modules.ts";

const here = (path: string): string => fileURLToPath(new URL(path, import.meta.url));

/** Builds the page of light probes as one self-contained file, `lightwell/viewer/probes.html`. */
export default defineConfig({
  root: here("probes"),
  resolve: { alias: Object.entries(MODULES).map(([name, path]) => ({ find: new RegExp(`^${name}$`), replacement: path })) },
  plugins: [
    viteSingleFile({ removeViteModuleLoader: true }),
    { name: "name", enforce: "post", generateBundle(_, files) { files["index.html"]!.fileName = "probes.html"; } },
  ],
  build: { outDir: here("../lightwell/viewer"), emptyOutDir: false, target: "es2022", cssMinify: true, reportCompressedSize: false },
});
