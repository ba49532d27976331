/** What a frame of the lens takes: it fits the limits that every WebGPU device has, up to 1920x1080. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { plan, readLibrary } from "lightwell/lens";
import { describe, expect, it } from "vitest";

const standard = (name: string) => readLibrary(new Uint8Array(readFileSync(fileURLToPath(new URL(`../../lightwell/lens/standard/${name}.lwsp`, import.meta.url)))));
/** Limits of a device that asks for none (WebGPU): bytes of a binding, bytes that a workgroup shares, buffers of a shader. */
const [BINDING, SHARED, BUFFERS] = [1 << 27, 1 << 14, 8];

describe.each([
  [1920, 1080, 2, false],
  [1280, 720, 2, true],
  [1, 1, 2, false],
  [333, 777, 4, true],
  [1920, 1080, 4, false],
])("%i x %i, %i layers, motion %s", async (width, height, layers, moves) => {
  const moving = moves ? await standard("disc-16-speed-32") : null;
  const still = await standard("disc-32");
  const options = { width, height, still, moving, layers, largest: moves ? 16 : 32, longest: 32, extend: true, format: "rgba16float" } as const;
  const { domain, guard, buffers, shaders, steps } = plan(options);

  it("fits the limits", () => {
    expect(8 * Math.max(...domain)).toBeLessThanOrEqual(SHARED);
    for (const { bytes } of Object.values(buffers)) expect(bytes).toBeLessThanOrEqual(BINDING);
    for (const { bindings } of Object.values(shaders)) expect(bindings.filter((kind) => kind === "read" || kind === "write").length).toBeLessThanOrEqual(BUFFERS);
    const megabytes = Object.values(buffers).reduce((sum, one) => sum + one.bytes, 0) / 1e6;
    expect(megabytes).toBeLessThan(20 + (width * height * 186) / 1e6 + (200 * (width + height) * 64) / 1e6);
  });

  it("has room for what leaves the picture, and every step finds what it uses", () => {
    expect(domain[0]).toBeGreaterThanOrEqual(width + guard);
    expect(domain[1]).toBeGreaterThanOrEqual(height + 2 * guard);
    const known = new Set([...Object.keys(buffers), "color", "depth", "motion", "picture"]);
    for (const step of steps) {
      if ("clear" in step) expect(known.has(step.clear)).toBe(true);
      else {
        expect(step.uses.length).toBe(shaders[step.shader]!.bindings.length);
        for (const name of step.uses) expect(known.has(name)).toBe(true);
        expect(new Set(step.uses).size).toBe(step.uses.length);
      }
    }
    expect(Math.max(...steps.flatMap((step) => ("clear" in step ? [0] : step.groups)))).toBeLessThan(65_536);
  });
});
