/** A light map of three lamps in two pictures: with either renderer of three.js, a switch changes the picture as it says. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import type { LampSetting } from "lightwell";
import { describe, expect, it } from "vitest";
import type { Request } from "./pages/renderers.ts";
import { openModule } from "./support/module-page.ts";

const [WIDTH, HEIGHT] = [96, 72];
const file = (name: string) => readFileSync(fileURLToPath(new URL(`fixtures/${name}`, import.meta.url)));
const GLB = file("lightmap-lamps.glb").toString("base64");
/** What each lamp takes of each picture, by channel; texels of the pictures on the wall; the unit of radiance (tools/lightmap_example.py). */
const { taken, bytes, unit } = JSON.parse(file("lightmap-lamps.json").toString()) as { taken: number[][][]; bytes: number[]; unit: number };
const LAMPS = ["warm", "cool", "both"];
const ALBEDO = [0.7, 0.7, 0.8];
const CAMERA: Request["camera"] = { position: [0.4, 1.1, 2.6], target: [0, 0.7, -0.4], fovY: 45 };

type Settings = Record<string, LampSetting>;

/** Factors of a setting: intensity · colour. */
function factors(setting: LampSetting | undefined): number[] {
  if (setting === undefined) return [1, 1, 1];
  if (typeof setting === "number") return [setting, setting, setting];
  return ((setting.color as number[] | undefined) ?? [1, 1, 1]).map((c) => c * (setting.intensity ?? 1));
}

/** The closed form of the wall, which is Lambertian and evenly lit. */
function wall(settings: Settings): number[] {
  return ALBEDO.map((albedo, c) => {
    const light = bytes.map((byte, r) => {
      const u = (byte / 255) ** 2;
      const weight = LAMPS.reduce((sum, name, k) => sum + factors(settings[name])[c]! * taken[k]![r]![c]!, 0);
      return (weight * u) / (1 + 1 / 64 - u);
    });
    return albedo * unit * light.reduce((sum, x) => sum + x, 0);
  });
}

describe("a light map of lamps", () => {
  const opened = openModule("renderers.ts", "ready");

  const draw = async (kind: Request["kind"], lamps: Settings) => {
    const request: Request = { glb: GLB, kind, width: WIDTH, height: HEIGHT, camera: CAMERA, lamps };
    const { data } = await opened.page.evaluate((asked) => window.draw(asked), request);
    return (x: number, y: number) => data.slice(4 * (y * WIDTH + x), 4 * (y * WIDTH + x) + 3);
  };

  it.each((process.env.LIGHTWELL_LONG_TESTS ? ["webgl", "webgpu", "fallback"] : ["webgpu"]) as ("webgl" | "webgpu" | "fallback")[])("%s: is what its lamps say, and adds up", async (kind) => {
    const states: Settings[] = [{}, { cool: 0 }, { warm: { intensity: 2, color: [0.5, 0, 1] }, cool: 0.3, both: 0 }, { warm: 0, cool: 0, both: 0 }];
    for (const lamps of states) {
      const at = await draw(kind, lamps);
      const expected = wall(lamps);
      for (const [x, y] of [[36, 14], [48, 20], [58, 26]] as const) {
        at(x, y).forEach((value, c) => expect(Math.abs(value - expected[c]!)).toBeLessThan(2e-3 * (0.05 + expected[c]!)));
      }
    }
    // The floor shines as well: what each lamp alone shows there is not what the others do, and their sum is the whole.
    const off = { warm: 0, cool: 0, both: 0 };
    const alone = [];
    for (const name of LAMPS) alone.push(await draw(kind, { ...off, [name]: 1 }));
    const whole = await draw(kind, {});
    for (const [x, y] of [[36, 60], [48, 64], [60, 66]] as const) {
      const parts = alone.map((at) => at(x, y));
      expect(Math.min(...parts.flat())).toBeGreaterThan(0);
      expect(parts[0]![0]! / parts[1]![0]!).not.toBeCloseTo(parts[0]![2]! / parts[1]![2]!, 1);
      whole(x, y).forEach((value, c) => {
        const sum = parts.reduce((total, part) => total + part[c]!, 0);
        expect(Math.abs(value / sum - 1)).toBeLessThan(3e-3);
      });
    }
  });
});
