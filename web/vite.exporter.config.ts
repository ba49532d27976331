import { fileURLToPath } from "node:url";
import { defineConfig } from "vite";

const here = (path: string): string => fileURLToPath(new URL(path, import.meta.url));

/** Builds the exporter that `lightwell export` runs. */
export default defineConfig({
  publicDir: false,
  build: {
    lib: { entry: here("exporter/main.ts"), formats: ["iife"], name: "lightwellExporter", fileName: () => "exporter.js" },
    outDir: here("../lightwell/graph"),
    emptyOutDir: false,
    target: "es2020",
    reportCompressedSize: false,
  },
});
