/** Sun and sky of a day: the numbers that Python evaluates too, the clock, and a sun that follows it. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { clockText, FormatError, readClock, SkyBackground, SunLamp, sunsWithSky } from "lightwell";
import { Box3, Group, Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { Placement } from "../runtime/src/placement.ts";
import { hourAt, levelAt, readSky, type Sky, skyAt, sunlightAt, timeOfHour } from "../runtime/src/sky.ts";
import { readVariables, type SunVariable } from "../runtime/src/variables.ts";

type Triple = [number, number, number];
interface Row {
  readonly time: number;
  readonly sun: Triple;
  readonly view: Triple;
  readonly radiance: Triple;
  readonly sunlight: Triple;
  readonly level: number;
}

const VECTORS = JSON.parse(readFileSync(fileURLToPath(new URL("../../tests/scenes/sky_vectors.json", import.meta.url)), "utf8")) as { sky: object; rows: Row[] };
const sky = readSky(VECTORS.sky, "sky") as Sky;

const near = (found: readonly number[], wanted: readonly number[]) =>
  found.forEach((x, i) => expect(Math.abs(x - wanted[i]!)).toBeLessThanOrEqual(1e-6 * Math.abs(wanted[i]!) + 1e-12));

function variable(changed: object = {}): SunVariable {
  const entry = { kind: "sun", name: "day", start: [1, 0.05, 0], middle: [0, 0.9, 0.4], end: [-1, 0.05, 0], intensity: 2, sky: { ...VECTORS.sky, ...changed } };
  return readVariables([entry], "variables")[0] as SunVariable;
}

describe("light of a sky", () => {
  it("is that of Python", () => {
    for (const { time, sun, view, radiance, sunlight, level } of VECTORS.rows) {
      near(skyAt(sky, time, sun, view), radiance);
      near(sunlightAt(sky, time), sunlight);
      near([levelAt(sky, time)], [level]);
    }
  });

  it("is refused with the place of what is wrong", () => {
    for (const [changed, text] of [
      [{ times: [0, 0.5, 0.9] }, "sky.times: expected increasing numbers from 0 to 1"],
      [{ times: [0, 1] }, "sky.level: expected as many as times, 2"],
      [{ level: [0, 1, 1] }, "sky.level[0]: expected a number in"],
      [{ hours: [9, 8, 20] }, "sky.hours: expected three increasing hours"],
      [{ model: [[1], [1], [1]] }, "sky.model[0]: expected 27 numbers"],
      [{ turbidity: 0 }, "sky.turbidity: expected a number in [1, 10]"],
    ] as const) {
      expect(() => variable(changed)).toThrow(FormatError);
      expect(() => variable(changed)).toThrow(text);
    }
  });
});

describe("a clock", () => {
  it("is read and shown", () => {
    expect([readClock("18:30"), readClock(" 7.25 "), readClock("24:30"), readClock("noon"), readClock("")]).toEqual([18.5, 7.25, null, null, null]);
    expect([clockText(18.5), clockText(-0.5), clockText(24.25)]).toEqual(["18:30", "23:30", "00:15"]);
  });

  it("goes linearly through each half of the arc", () => {
    expect(hourAt(sky, 0)).toBe(4.6);
    expect(hourAt(sky, 0.5)).toBe(12.25);
    expect(hourAt(sky, 1)).toBeCloseTo(19.9, 9);
    for (const hour of [4.6, 9, 12.25, 18.5, 19.9]) expect(hourAt(sky, timeOfHour(sky, hour)!)).toBeCloseTo(hour, 9);
    expect(timeOfHour(sky, 23)).toBeNull();
  });
});

describe("a sun with a sky", () => {
  const lamp = () => new SunLamp(variable(), new Box3(new Vector3(), new Vector3(1, 1, 1)), new Placement(new Group()));

  it("has the colour of the time, and its field the level", () => {
    const sun = lamp();
    for (const t of [0, 0.3, 1]) {
      sun.move(sun.arc.at(t, new Vector3()));
      sun.tint();
      expect(sun.time).toBeCloseTo(t, 5);
      expect(sun.level).toBeCloseTo(levelAt(sky, sun.time), 9);
      near(sun.object.color.toArray(), sunlightAt(sky, sun.time));
      expect(sun.object.intensity).toBe(2);
    }
  });

  it("takes up a colour that is set on the three.js light", () => {
    const sun = lamp();
    sun.move(sun.arc.at(0.4, new Vector3()));
    sun.tint();
    sun.object.color.setRGB(0.2, 0.3, 0.1);
    sun.follow();
    near(sun.color.toArray(), [0.2, 0.3, 0.1].map((x, i) => x / sunlightAt(sky, sun.time)[i]!));
  });

  it("takes it up before it is tinted as well", () => {
    const sun = lamp();
    sun.object.color.setRGB(0.2, 0.3, 0.1);
    sun.object.intensity = 7;
    sun.tint();
    near(sun.object.color.toArray(), [0.2, 0.3, 0.1]);
    expect([sun.object.intensity, sun.intensity]).toEqual([7, 7]);
  });

  it("has a picture of its sky that follows it", () => {
    const [sun, background] = [lamp(), new SkyBackground()];
    expect(sunsWithSky([sun])).toEqual([sun]);
    expect(background.update([sun])).toBe(true);
    expect(background.update([sun])).toBe(false);
    const before = (background.texture.image.data as unknown as Uint16Array).slice();
    expect(before.slice(0, 3)).toEqual(new Uint16Array(3));
    // The horizon lies between two rows, and the sky begins at once.
    const { width, height } = background.texture.image as { width: number; height: number };
    const row = (y: number) => before.slice(4 * y * width, 4 * (y + 1) * width).filter((_, i) => i % 4 < 3);
    expect(row(height / 2 - 1).every((x) => x === 0)).toBe(true);
    expect(row(height / 2).every((x) => x > 0)).toBe(true);
    sun.move(sun.arc.at(0.9, new Vector3()));
    expect(background.update([sun])).toBe(true);
    expect(background.texture.image.data).not.toEqual(before);
    background.dispose();
  });
});
