/** The modules of the npm package by the names under which they are imported. */

import { fileURLToPath } from "node:url";

const source = (path: string): string => fileURLToPath(new URL(`runtime/src/${path}`, import.meta.url));

export const MODULES = {
  lightwell: source("index.ts"),
  "lightwell/graph": source("graph/index.ts"),
  "lightwell/webgpu": source("webgpu/index.ts"),
  "lightwell/gltf-transform": source("gltf-transform.ts"),
  "lightwell/react": source("react/index.ts"),
  "lightwell/element": source("element/index.ts"),
  "lightwell/babylon": source("babylon/index.ts"),
  "lightwell/playcanvas": source("playcanvas/index.ts"),
  "lightwell/export": source("export.ts"),
  "lightwell/probes": source("probes/index.ts"),
  "lightwell/probes/webgpu": source("probes/webgpu.ts"),
  "lightwell/lens": source("lens/index.ts"),
  "lightwell/lens/three": source("lens/three.ts"),
} as const;
