/** three.js' own ways count: where things stand, what is done to lights and materials, several scenes and renderers. */

import { describe, expect, it } from "vitest";
import type { Result, Scenarios } from "./pages/three-ways.ts";
import { keepFigure } from "./support/figures.ts";
import { furnishedRoom, WHITE } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";
import { KINDS, useScenarios } from "./support/scenarios.ts";

/** A field that shows the direction to the eye: 0.5 + 0.4 · view. */
const VIEWS = writeGlb(
  furnishedRoom({
    variables: [],
    fields: [
      {
        name: "views",
        role: "static",
        graph: {
          version: 1,
          inputs: { view: 3 },
          nodes: [{ id: "y", op: "affine", inputs: ["view"], scale: [0.4, 0.4, 0.4], offset: [0.5, 0.5, 0.5] }],
          outputs: { radiance: "y" },
        },
      },
    ],
  }),
);
const REFLECTANCE = WHITE[0] + 0.04;

/** What three.js (r187) says of its own copy of a physical material of nodes. */
const OF_COPIES = '"iridescenceThicknessRange" property has been replaced';

const opened = useScenarios("pages/three-ways.ts", { views: VIEWS });

/** Share of the components of two pictures that differ by more than a hundredth. */
function difference(a: readonly number[], b: readonly number[]): number {
  return a.filter((x, i) => Math.abs(x - b[i]!) > 0.01 * Math.max(0.2, Math.abs(x))).length / a.length;
}
/** Pixels on the edges of shadows and things. */
const EDGES = 0.02;

/** Megabytes that fifty cycles may leave. */
const LEAST_LEAK = 0.5;

/** Bytes of JavaScript objects that are in use. */
async function heap(): Promise<number> {
  const session = await opened.page.context().newCDPSession(opened.page);
  for (let i = 0; i < 2; i++) {
    await session.send("HeapProfiler.collectGarbage");
    // Devices end and finalisers run in tasks of their own.
    await new Promise((resolve) => setTimeout(resolve, 500));
  }
  await session.send("HeapProfiler.collectGarbage");
  const { usedSize } = await session.send("Runtime.getHeapUsage");
  await session.detach();
  return usedSize;
}

describe.each(KINDS)("%s:", (kind) => {
  async function run<K extends keyof Scenarios>(name: K): Promise<Result<K>> {
    const result = (await opened.run(name, kind)) as Result<K>;
    if (name !== "broken" && name !== "renderers") expect(opened.errors.filter((text) => !text.includes(OF_COPIES))).toEqual([]);
    return result;
  }

  it("a root that stands elsewhere, turned and scaled, is lit as it was baked", async () => {
    const [home, away] = await run("placed");
    expect(Math.max(...home!)).toBeGreaterThan(0.3);
    expect(difference(home!, away!)).toBeLessThan(EDGES);
  });

  it("a root with axes of different scales is refused", async () => {
    expect(await run("uneven")).toMatch(/expected axes of one scale at right angles, found scales 1\.00, 2\.00, 1\.00; scale all axes alike/);
  });

  it("a light that is moved, hung elsewhere, dimmed or coloured lights the field", async () => {
    const { pictures, clamped } = await run("lamp");
    const [moved, home, byPosition, onArm, undone] = pictures;
    expect(difference(moved!, home!)).toBeGreaterThan(0.2);
    expect(difference(moved!, byPosition!)).toBe(0);
    expect(difference(moved!, onArm!)).toBeLessThan(EDGES);
    expect(clamped).toEqual([0, 1.8, 0].map((x) => expect.closeTo(x, 5)));
    expect(difference(home!, undone!)).toBeGreaterThan(0.5);
  });

  // With WebGPURenderer, an `outputNode`.
  it("a user's onBeforeCompile works with ours, whichever came first, and stays when ours is gone", async () => {
    const [before, none, after, alone] = await run("hooks");
    const red = (picture: readonly number[]) => picture.filter((_, i) => i % 3 === 0);
    expect(Math.max(...red(before!).map((x, i) => Math.abs(x - red(none!)[i]! - 0.25)))).toBeLessThan(0.26);
    const lit = red(none!).map((x, i) => red(before!)[i]! - x).filter((x) => x !== 0);
    expect(lit.length).toBeGreaterThan(1000);
    for (const gain of lit) expect(gain).toBeCloseTo(0.25, 3);
    expect(difference(before!, after!)).toBe(0);
    expect(Math.min(...red(alone!).filter((x) => x > 0))).toBeCloseTo(0.25, 2);
  });

  // WebGLRenderer takes no nodes.
  if (kind !== "webgl") it("materials of nodes are lit, and a user's own nodes count, whichever came first", async () => {
    const { plain, numbers, glowing, left } = await run("nodes");
    expect(difference(plain[0]!, plain[1]!)).toBe(0);
    expect(difference(plain[0]!, numbers[0]!)).toBeGreaterThan(0.5);
    for (const picture of numbers) expect(difference(numbers[0]!, picture)).toBe(0);
    const [none, ...others] = glowing;
    expect(difference(plain[0]!, none!)).toBe(0);
    for (const picture of others) {
      const gain = picture.map((x, i) => x - none![i]!);
      expect(gain.filter((x, i) => i % 3 === 0 && Math.abs(x - 0.5) < 1e-3).length).toBeGreaterThan(1000);
      expect(Math.max(...gain.filter((_, i) => i % 3 !== 0).map(Math.abs))).toBeLessThan(1e-3);
    }
    expect(left).toEqual(left.map(() => true));
  });

  it("edits of materials show in every look, other materials too", async () => {
    const looks = Object.entries(await run("edits"));
    expect(looks).toHaveLength(2);
    for (const [, [plain, lit, other]] of looks) {
      expect(lit![0]! - plain![0]!).toBeCloseTo(0.5, 2);
      expect(lit![1]).toBeCloseTo(plain![1]!, 3);
      expect(other![1]).toBeGreaterThan(0.9);
    }
  });

  it("dispose gives everything back, and attach lights it again", async () => {
    const { pictures, first, left } = await run("restored");
    const [before, learned, after, again] = pictures;
    expect(left).toEqual(first);
    expect(difference(before!, learned!)).toBeGreaterThan(0.5);
    expect(difference(before!, after!)).toBe(0);
    expect(difference(learned!, again!)).toBe(0);
  });

  it("shadows follow the lamp's castShadow", async () => {
    const [shadowed, lit, again] = await run("shadows");
    const brighter = lit!.filter((x, i) => x > shadowed![i]! + 0.02).length / lit!.length;
    expect(brighter).toBeGreaterThan(0.02);
    expect(lit!.filter((x, i) => x < shadowed![i]! - 1e-3)).toEqual([]);
    expect(difference(shadowed!, again!)).toBe(0);
  });

  it("dispose frees the model's textures unless they are to stay", async () => {
    expect(await run("textures")).toEqual([0, 1]);
  });

  it("a root has one scene; two scenes on a page do not mix", async () => {
    const { pictures, lights } = await run("twice");
    const [first, second, third, other, still] = pictures;
    expect(lights).toBe(1);
    for (const same of [second, third, still]) expect(difference(first!, same!)).toBe(0);
    expect(difference(first!, other!)).toBeGreaterThan(0.5);
  });

  it("a material of another scene is refused", async () => {
    const { messages, left } = await run("shared");
    for (const message of messages) expect(message).toMatch(/^LearnedScene: material 'paint' belongs to another scene; clone it/);
    expect([messages.length, left]).toEqual([2, 0]);
  });

  it("several renderers and a restored context draw the same, shadows included", async () => {
    const [a, b, c, d, moved, movedToo, restored] = await run("renderers");
    for (const same of [b, c, d]) expect(difference(a!, same!)).toBe(0);
    expect(difference(a!, moved!)).toBeGreaterThan(0.2);
    expect(difference(moved!, movedToo!)).toBe(0);
    expect(difference(moved!, restored!)).toBe(0);
    expect(opened.errors.filter((text) => !/(Context|Device) (Lost|Restored)/.test(text))).toEqual([]);
  });

  // Filtering an environment map takes half a minute without a GPU.
  it.each(process.env.LIGHTWELL_LONG_TESTS ? [""] : [])("the light of an environment map is left out unless it is asked for", async () => {
    const [none, removed, kept] = await run("environments");
    expect(difference(none!, removed!)).toBe(0);
    expect(difference(none!, kept!)).toBeGreaterThan(0.5);
  });

  it("a parallel camera sees the learned light", async () => {
    const { picture, direction } = await run("parallel");
    const expected = direction.map((x) => REFLECTANCE * (0.5 + 0.4 * x));
    const seen = Array.from({ length: picture.length / 3 }, (_, i) => picture.slice(3 * i, 3 * i + 3));
    const right = seen.filter((rgb) => rgb.every((x, c) => Math.abs(x - expected[c]!) < 1e-3));
    // All that is white: walls, floor and boxes.
    expect(right.length / seen.length).toBeGreaterThan(0.5);
  });

  it("nothing is left after loading and disposing again and again", async () => {
    const cycles = await run("cycles");
    expect(cycles.slice(2)).toEqual(Array(cycles.length - 2).fill(cycles[1]));
  });

  it("nothing is left in any order of detach and dispose", async () => {
    const [, first, ...others] = await run("orders");
    expect(others).toEqual(others.map(() => first));
  });

  it.each(process.env.LIGHTWELL_LONG_TESTS || process.env.LIGHTWELL_MEASURE ? [""] : [])("memory is flat over fifty cycles of loading and disposing", async () => {
    const turns = (count?: number) => opened.page.evaluate((n) => void (n ? (document.body.dataset.cycles = String(n)) : delete document.body.dataset.cycles), count);
    await turns(50);
    let cycles = await run("cycles");
    let grown = Infinity;
    // What is compiled or cached once makes the first heaps grow; a leak makes every one grow.
    for (let round = 0; round < 3 && grown >= LEAST_LEAK; round++) {
      const before = await heap();
      cycles = await run("cycles");
      grown = ((await heap()) - before) / 1e6;
    }
    await turns();
    keepFigure(`memory grown over 50 cycles, MB${kind === "webgl" ? "" : `, ${kind}`}`, grown);
    expect(cycles).toHaveLength(50);
    expect(cycles.at(-1)).toEqual(cycles[1]);
    expect(grown).toBeLessThan(LEAST_LEAK);
  }, 300_000);

  // WebGPURenderer has no texts that a user could change.
  if (kind === "webgl") it("a shader without the part that ours goes into is said", async () => {
    expect(await run("broken")).toMatch(/expected '#include <opaque_fragment>' in a shader of three\.js, found none/);
  });
});
