import { fileURLToPath } from "node:url";
import { defineConfig, type Plugin } from "vite";
import * as three from "three";

const here = (path: string): string => fileURLToPath(new URL(path, import.meta.url));
const NAMES = Object.keys(three).filter((name) => name !== "default");

/** Where there is no A-Frame, as on servers, the module can be imported all the same. */
const SHIM = `class Missing {}
const THREE = globalThis.AFRAME?.THREE ?? {};
${NAMES.map((name) => `export const ${name} = THREE.${name} ?? Missing;`).join("\n")}`;

/** What stands for three.js and its loader: those of A-Frame, for a loader needs the three.js of its own version. */
const SHIMS: Readonly<Record<string, string>> = {
  three: SHIM,
  "three/addons/loaders/GLTFLoader.js": "export const GLTFLoader = globalThis.AFRAME?.THREE.GLTFLoader;",
};

/** Takes three.js from the global A-Frame in place of a copy of its own: objects of two three.js do not know each other. */
const ofAFrame: Plugin = {
  name: "three-of-aframe",
  enforce: "pre",
  resolveId: (id) => (id in SHIMS ? `\0${id}` : null),
  load: (id) => SHIMS[id.slice(1)] ?? null,
};

/** Builds `lightwell-aframe.js`, for a page that has A-Frame: one file, whatever parts of it a page needs. */
export default defineConfig({
  publicDir: false,
  resolve: { alias: [{ find: "three/addons/loaders/KTX2Loader.js", replacement: here("runtime/src/element/no-ktx2.ts") }] },
  plugins: [ofAFrame],
  build: {
    lib: { entry: here("runtime/src/aframe/index.ts"), formats: ["es"], fileName: () => "lightwell-aframe.js" },
    rollupOptions: { treeshake: { propertyReadSideEffects: false }, output: { codeSplitting: false, minify: true } },
    outDir: here("runtime/dist"),
    emptyOutDir: false,
    target: "es2022",
    reportCompressedSize: false,
  },
});
