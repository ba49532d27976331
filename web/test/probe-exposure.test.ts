import { expect, test } from "vitest";
import { meteredExposure } from "../probes/exposure.ts";

test("probes in the dark outside a scene do not make the page of the probes too bright", () => {
  const lit = Array.from({ length: 40 }, (_, i) => 1 + i / 40);
  const outside = new Array(60).fill(0.01);
  const [alone, with60] = [meteredExposure(lit), meteredExposure([...outside, ...lit])];
  expect(with60 / alone).toBeGreaterThan(0.8);
  expect(with60 / alone).toBeLessThan(1.25);
  // A white surface in the brightest light is not more than just clipped.
  expect((with60 * 2) / Math.PI).toBeLessThan(1);
});

test("a volume without light has an exposure", () => {
  expect(Number.isFinite(meteredExposure([]))).toBe(true);
  expect(Number.isFinite(meteredExposure([0, 0]))).toBe(true);
});
