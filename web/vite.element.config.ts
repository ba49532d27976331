import { fileURLToPath } from "node:url";
import { defineConfig } from "vite";
import { MODULES } from "./modules.ts";

/** Builds `lightwell-viewer.js`: the custom element with three.js inside, for a page without a build step. */
export default defineConfig({
  publicDir: false,
  resolve: { alias: [{ find: "three/addons/loaders/KTX2Loader.js", replacement: fileURLToPath(new URL("runtime/src/element/no-ktx2.ts", import.meta.url)) }] },
  build: {
    lib: { entry: MODULES["lightwell/element"], formats: ["es"], fileName: () => "lightwell-viewer.js" },
    // One file, whatever parts of it a page needs.
    rollupOptions: { output: { codeSplitting: false, minify: true } },
    outDir: fileURLToPath(new URL("runtime/dist", import.meta.url)),
    emptyOutDir: false,
    target: "es2022",
    reportCompressedSize: false,
  },
});
