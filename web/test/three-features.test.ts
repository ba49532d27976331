/** Features of three.js that users combine with learned light: each draws what it draws without, where that can be said. */

import { afterEach, describe, expect, it } from "vitest";
import type { Result, Scenarios } from "./pages/three-features.ts";
import { KINDS, useScenarios } from "./support/scenarios.ts";

type Picture = readonly number[];

const opened = useScenarios("pages/three-features.ts");

afterEach(() => {
  // Said of the device that draws into no floats.
  expect(opened.errors.filter((text) => !text.includes("EXT_color_buffer_float extension not supported"))).toEqual([]);
});

const difference = (a: Picture, b: Picture) => a.reduce((largest, x, i) => Math.max(largest, Math.abs(x - b[i]!)), 0);
const mean = (a: Picture) => a.reduce((sum, x) => sum + x, 0) / a.length;
/** Mean difference: edges of what moved may fall on other pixels by rounding. */
const apart = (a: Picture, b: Picture) => mean(a.map((x, i) => Math.abs(x - b[i]!)));

describe.each(KINDS)("%s:", (kind) => {
  const run = <K extends keyof Scenarios>(name: K) => opened.run(name, kind) as Promise<Result<K>>;

  it("instances, skins and morph targets are lit where they are", async () => {
    const [asMesh, asInstance, byBone, byMorph, still] = await run("meshes");
    expect(apart(asMesh!, still!)).toBeGreaterThan(1e-3);
    for (const other of [asInstance, byBone, byMorph]) expect(apart(asMesh!, other!)).toBeLessThan(2e-5);
  });

  it("clipping planes cut", async () => {
    const [whole, cut] = await run("clipping");
    const side = (picture: Picture, left: boolean) => picture.filter((_, i) => ((i / 3) % 64 < 31) === left && ((i / 3) % 64 < 31 || (i / 3) % 64 > 33));
    expect(Math.max(...side(cut!, true))).toBe(0);
    expect(mean(side(whole!, true))).toBeGreaterThan(0.01);
    // The shadow is that of the cut scene.
    expect(mean(side(cut!, false))).toBeGreaterThan(0.9 * mean(side(whole!, false)));
  });

  it("a logarithmic depth buffer draws the same", async () => {
    const [plain, logarithmic] = await run("depth");
    expect(apart(plain!, logarithmic!)).toBeLessThan(1e-4);
  });

  // What WebGPURenderer draws with has them.
  if (kind === "webgl") it("a device that draws into no floats shows the same", async () => {
    const [with_, without] = await run("withoutHalfFloats");
    expect(new Set(with_).size).toBeGreaterThan(40);
    expect(difference(with_!, without!)).toBeLessThanOrEqual(1);
  });

  it("both eyes of a headset see what each sees alone", async () => {
    const [left, right, leftOfBoth, rightOfBoth] = await run("eyes");
    expect(difference(left!, right!)).toBeGreaterThan(0.1);
    expect(difference(left!, leftOfBoth!)).toBeLessThan(1e-4);
    // The pattern by which three.js filters shadows goes by the pixel of the target, and this eye begins in its middle.
    expect(apart(right!, rightOfBoth!)).toBeLessThan(1e-3);
    expect(difference(right!, rightOfBoth!)).toBeLessThan(0.05);
  });

  it("lamps of others add, and fog lies over everything", async () => {
    const [alone, lit, foggy, lampAlone] = await run("others");
    // The surface model of learned materials is that of the bake: not the very light that three.js' own adds.
    const added = lit!.map((x, i) => x - alone![i]!);
    expect(Math.min(...added)).toBeGreaterThan(-1e-4);
    expect(mean(added) / mean(lampAlone!)).toBeGreaterThan(0.8);
    expect(mean(added) / mean(lampAlone!)).toBeLessThan(1.25);
    // Blue at the back wall, which lies beyond the far end of the fog.
    const middle = 3 * (64 * 24 + 32);
    expect(foggy!.slice(middle, middle + 3).map((x) => x.toFixed(2))).toEqual(["0.03", "0.13", "1.00"]);
  });

  it("loadLight lights a model that was loaded elsewhere, and refuses what is no file", async () => {
    const { pictures, refused } = await run("elsewhere");
    expect(difference(pictures[0]!, pictures[1]!)).toBeLessThan(1e-5);
    expect(refused).toMatch(/^FormatError: /);
  });
});
