/** References of a day: which one is shown for a time, and what the page says where it was traced for another. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { hourAt, northAt, SunLamp } from "lightwell";
import { Box3, Group, Vector3 } from "three";
import type { Browser } from "playwright-core";
import { afterAll, beforeAll, describe, expect, it } from "vitest";
import { TurningLamp } from "../runtime/src/turning-lamp.ts";
import { Placement } from "../runtime/src/placement.ts";
import { readVariables, type SunVariable } from "../runtime/src/variables.ts";
import { readPageData } from "../viewer/src/page-data.ts";
import { nameOfView, nearestReference, otherMoment } from "../viewer/src/view-moment.ts";
import { launch, openPage, Site } from "./support/browser.ts";
import { plainRoom, stillField } from "./support/fixtures.ts";
import { type Fixture, writeGlb } from "./support/glb.ts";
import { packReference, pageWith } from "./support/page.ts";

const { sky } = JSON.parse(readFileSync(fileURLToPath(new URL("../../tests/scenes/sky_vectors.json", import.meta.url)), "utf8")) as { sky: object };
const SUN = { kind: "sun", name: "day", start: [1, 0.05, 0], middle: [0, 0.9, 0.4], end: [-1, 0.05, 0], intensity: 2, sky };

function sun(): SunLamp {
  return new SunLamp(readVariables([SUN], "variables")[0] as SunVariable, new Box3(new Vector3(), new Vector3(1, 1, 1)), new Placement(new Group()));
}

/** A sky came with the second version of the format. */
const tamper: Fixture["tamper"] = (json: any) => void Object.assign(json.extensions.LIGHTWELL_neural_radiance, { version: 2 });

/** Saved views with a black reference each: eye, and time of the sun on its arc. */
function views(places: readonly [eye: [number, number, number], time: number][]) {
  const { arc } = sun();
  const reference = { width: 4, height: 3, ...packReference(new Float32Array(36), 4) };
  return places.map(([position, time], i) => ({ name: `view ${i}`, camera: { position, target: [0, 1, 0] }, light: arc.at(time, new Vector3()).toArray(), ...reference }));
}

const SAVED = views([[[0, 1, 4], 0.3], [[0, 1, 4], 0.75], [[0, 1, 9], 0.5]]);

describe("saved views of a day", () => {
  const saved = readPageData({ views: SAVED }).views;

  it("have the hour of their sun in their name; without a clock there is none", () => {
    expect(saved.map((view) => nameOfView(view, [sun()]))).toEqual(["view 0, 09:11", "view 1, 16:05", "view 2, 12:15"]);
    expect(nameOfView(saved[0]!, [])).toBe("view 0");
  });

  it("are found by the eye, and by the hour where several have one eye", () => {
    const lamp = sun();
    for (const [time, eye, expected] of [[0.1, 4, 0], [0.9, 4, 1], [0.1, 8, 2]] as const) {
      lamp.move(lamp.arc.at(time, new Vector3()));
      expect(nearestReference(saved, new Vector3(0, 1, eye), [lamp])).toBe(expected);
    }
  });

  it("say where they were traced for another hour", () => {
    const lamp = sun();
    expect(otherMoment(saved[2]!, { at: hourAt(lamp.variable.sky!, 0.5)!, kind: "hour" }, [lamp])).toBeNull();
    expect(otherMoment(saved[2]!, { at: 18.5, kind: "hour" }, [lamp])).toBe("The reference of “view 2” was traced for 12:15, not 18:30.");
  });
});

describe("saved views of a map that turns", () => {
  const map = new TurningLamp({ kind: "environment", name: "environment", range: [0, 360], initial: northAt(0), intensity: 1, color: [1, 1, 1] }, new Group());
  const reference = { width: 4, height: 3, ...packReference(new Float32Array(36), 4) };
  const saved = readPageData({ views: [10, 200].map((angle, i) => ({ name: `view ${i}`, camera: { position: [0, 1, 4], target: [0, 1, 0] }, light: northAt(angle), ...reference })) }).views;

  it("have its angle in their name, and are found by the nearest angle, a whole turn aside", () => {
    expect(saved.map((view) => nameOfView(view, [map]))).toEqual(["view 0, 10°", "view 1, 200°"]);
    for (const [angle, expected] of [[350, 0], [120, 1]] as const) {
      map.move(new Vector3(...northAt(angle)));
      expect(nearestReference(saved, new Vector3(0, 1, 4), [map])).toBe(expected);
    }
    expect(otherMoment(saved[0]!, { at: 350, kind: "angle" }, [map])).toBe("The reference of “view 0” was traced for 10°, not 350°.");
    expect(otherMoment(saved[0]!, { at: 370.2, kind: "angle" }, [map])).toBeNull();
  });
});

describe("the page", () => {
  let browser: Browser;
  const site = new Site();

  beforeAll(async () => {
    await site.open();
    browser = await launch("llvmpipe");
  });

  afterAll(async () => {
    await browser?.close();
    await site.close();
  });

  it("shows the reference of the nearest hour and says which, and goes back to the hour that was asked for", async () => {
    const address = site.put("/day.html", pageWith(writeGlb(plainRoom({ variables: [SUN], fields: [stillField()], tamper })), { views: SAVED }));
    const { page, errors } = await openPage(browser, 320, 240);
    await page.goto(`${address}?camera=0,1,5,0,1,0,40&day=18:30&mode=reference`);
    await page.evaluate(() => window.lightwell.ready);
    const shown = () => page.evaluate(() => ({ ...window.lightwell.stats(), day: new URL(window.lightwell.link()).searchParams.get("day") }));
    expect(await shown()).toMatchObject({ mode: "reference", view: 1, day: "16:05", notice: "The reference of “view 1” was traced for 16:05, not 18:30." });
    expect(await page.locator(".views .view").allTextContents()).toEqual(["view 0, 09:11", "view 1, 16:05", "view 2, 12:15"]);
    await page.evaluate(() => window.lightwell.setMode("learned"));
    expect((await shown()).day).toBe("18:30");
    // The link of a saved view names its hour, too: it is the view's own.
    await page.evaluate(() => window.lightwell.setView(1));
    await page.goto(await page.evaluate(() => window.lightwell.link()));
    await page.evaluate(() => window.lightwell.ready);
    expect(await shown()).toMatchObject({ mode: "learned", view: 1, day: "16:05" });
    expect(errors).toEqual([]);
  });
});
