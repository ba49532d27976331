import { fileURLToPath } from "node:url";
import { defineConfig } from "vite";
import { MODULES } from "./modules.ts";

const here = (path: string): string => fileURLToPath(new URL(path, import.meta.url));
const source = here("runtime/src/");
/** Path in `dist` of a source file: as it lies there. */
const name = (path: string): string => path.slice(source.length).replace(/\.ts$/, "");

/**
 * Builds the npm package into `runtime/dist`: one module per source file, so that bundlers take what is used, with three.js
 * left to the page. `tsc -p tsconfig.package.json` writes the types beside it.
 */
export default defineConfig({
  publicDir: false,
  build: {
    lib: {
      entry: Object.fromEntries(Object.entries(MODULES).map(([, path]) => [name(path), path])),
      formats: ["es"],
    },
    rollupOptions: {
      external: [/^three($|\/)/, /^@gltf-transform\//, /^@babylonjs\//, /^playcanvas($|\/)/, /^@react-three\//, /^react($|\/)/],
      // A build of a library keeps white space otherwise.
      output: { preserveModules: true, preserveModulesRoot: here("runtime/src"), entryFileNames: "[name].js", minify: true },
    },
    outDir: here("runtime/dist"),
    emptyOutDir: true,
    minify: true,
    target: "es2022",
    reportCompressedSize: false,
  },
});
