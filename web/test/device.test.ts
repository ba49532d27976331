/** Which rasterisers are told from GPUs. */

import { inlineLimit, isSoftware } from "lightwell";
import type { WebGLRenderer } from "three";
import { expect, it } from "vitest";

const SOFTWARE = [
  "ANGLE (Google, Vulkan 1.3.0 (SwiftShader Device (Subzero) (0x0000C0DE)), SwiftShader driver)",
  "ANGLE (Mesa/X.org, llvmpipe (LLVM 15.0.6 256 bits), OpenGL ES 3.2)",
  "ANGLE (Microsoft, Microsoft Basic Render Driver Direct3D11 vs_5_0 ps_5_0)",
  "Generic Software Renderer",
];
const GPUS = ["ANGLE (NVIDIA, NVIDIA GeForce RTX 3060 Direct3D11)", "Apple M2", "Adreno (TM) 650", ""];

it.each(SOFTWARE)("%s runs on the CPU", (name) => {
  expect(isSoftware(name)).toBe(true);
  expect(inlineLimit(rendererOf(name))).toBe(16384);
});

it.each(GPUS)("“%s” is taken for a GPU", (name) => {
  expect(isSoftware(name)).toBe(false);
  expect(inlineLimit(rendererOf(name))).toBe(4096);
});

function rendererOf(name: string): WebGLRenderer {
  const gl = { RENDERER: 0x1f01, getExtension: () => null, getParameter: () => name };
  return { getContext: () => gl } as unknown as WebGLRenderer;
}
