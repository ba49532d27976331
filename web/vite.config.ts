import { fileURLToPath } from "node:url";
import { defineConfig } from "vite";
import { viteSingleFile } from "vite-plugin-singlefile";
import { lensPart } from "./lens-part.ts";

/** Path relative to this file. */
const here = (path: string): string => fileURLToPath(new URL(path, import.meta.url));

/** What the page's script and that of the lens have in common. */
const common = {
  root: here("viewer"),
  resolve: {
    alias: [
      { find: /^lightwell\/webgpu$/, replacement: here("runtime/src/webgpu/index.ts") },
      { find: /^lightwell\/lens$/, replacement: here("runtime/src/lens/index.ts") },
      { find: "three/addons/loaders/KTX2Loader.js", replacement: here("runtime/src/element/no-ktx2.ts") },
      { find: /^lightwell$/, replacement: here("runtime/src/index.ts") },
    ],
  },
  assetsInclude: ["**/*.lwsp"],
  build: { target: "es2022", reportCompressedSize: false },
};

/** Builds the viewer as one self-contained page that ships inside the Python package. */
export default defineConfig({
  ...common,
  plugins: [lensPart(common), viteSingleFile({ removeViteModuleLoader: true })],
  build: {
    ...common.build,
    outDir: here("../lightwell/viewer"),
    emptyOutDir: false,
    cssMinify: true,
  },
});
