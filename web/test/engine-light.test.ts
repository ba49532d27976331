/** The light for engines other than three.js: near a lamp as with three.js, and with what a device can draw into. */

import { PIXELFORMAT_R32F, PIXELFORMAT_RGBA16F } from "playcanvas";
import { expect, it } from "vitest";
import { EngineLight } from "../runtime/src/engines/engine-light.ts";
import { MIN_REACH } from "../runtime/src/falloff.ts";
import { distanceFormat } from "../runtime/src/playcanvas/distance-cube.ts";
import { readVariables } from "../runtime/src/variables.ts";
import { LAMP } from "./support/fixtures.ts";

it("a lamp's light grows up to a millimetre, as with three.js", () => {
  const radiance = { variables: readVariables([LAMP], "variables"), movers: [], lamps: [], fields: [], probes: [], exposure: null, core: null, environment: null };
  expect(new EngineLight(radiance).code("", new Set())).toContain(`max( square, ${MIN_REACH} )`);
  expect(Number(MIN_REACH)).toBe(1e-3 ** 2);
});

it("distances are stored as floats, half floats, or not at all", () => {
  const device = (textureFloatRenderable: boolean, textureHalfFloatRenderable: boolean) => ({ textureFloatRenderable, textureHalfFloatRenderable });
  expect(distanceFormat(device(true, true))).toMatchObject({ format: PIXELFORMAT_R32F });
  // The largest half float: beyond it there is infinity.
  expect(distanceFormat(device(false, true))).toEqual({ format: PIXELFORMAT_RGBA16F, nothing: 65504 });
  expect(distanceFormat(device(false, false))).toBeNull();
});
