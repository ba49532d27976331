/** Animations of lamps: what is read, what the lamps are at the time of a key, what is learned and drawn of it; lights of three.js that change. */

import { LearnedScene, LightwellLoaderPlugin, loadLight, parseLearned } from "lightwell";
import { AnimationClip, AnimationMixer, ColorKeyframeTrack, NumberKeyframeTrack, type PointLight } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { describe, expect, it } from "vitest";
import { valuesAt } from "../runtime/src/lamp-clips.ts";
import type { LoadedLight } from "../runtime/src/loaded-light.ts";
import type { Answer, Request } from "./pages/renderers.ts";
import { CAMERA, WHITE } from "./support/fixtures.ts";
import { type Channel, FLICKER, lampRoom } from "./support/lamps.ts";
import { openModule } from "./support/module-page.ts";

const load = (bytes: Uint8Array<ArrayBuffer>) => parseLearned(new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser)), bytes.slice().buffer);

/** The lamps of a scene as the shaders have them: red of desk, of bed, then green, then blue. */
function factorsOf(learned: LearnedScene): number[] {
  return [...(learned as unknown as { ownLamps: { factors: Float32Array } }).ownLamps.factors];
}

const change = (n: number, other: Partial<Channel>): Channel[] => FLICKER.map((channel, i) => (i === n ? { ...channel, ...other } : channel));

describe("an animation of lamps", () => {
  it("is told with its name and its time, and sets the lamps in update", async () => {
    const learned = new LearnedScene(await load(lampRoom()));
    expect(learned.animations).toMatchObject([{ name: "Flicker", duration: 2 }]);
    learned.update(undefined, 5);
    expect(factorsOf(learned)).toEqual([1, 0.5, 1, 0.5, 1, 0.5]);
    learned.playAnimation("Flicker");
    learned.update(undefined, 5);
    expect(learned.switches.map(({ intensity }) => intensity)).toEqual([1, 0.5]);
    learned.update(undefined, 0.5);
    expect(factorsOf(learned)).toEqual([0.75, 0.5, 0.75, 0.5, 0.75, 0.5]);
    learned.update(undefined, 0.5);
    expect(factorsOf(learned)).toEqual([0.5, 0.5, 0.5, 0, 0.5, 0]);
    // 2.5 s are half a second.
    learned.update(undefined, 1.5);
    expect(factorsOf(learned)).toEqual([0.75, 0.5, 0.75, 0.5, 0.75, 0.5]);
    expect(() => learned.playAnimation("Dance")).toThrow("expected one of the animations Flicker, found 'Dance'");
  });

  it("stays at its end where it does not loop, and gives back what the lamps were", async () => {
    const learned = new LearnedScene(await load(lampRoom()));
    learned.setLamp("desk", 0.3);
    learned.playAnimation("Flicker", { loop: false });
    learned.update();
    learned.update(undefined, 9);
    expect(factorsOf(learned)).toEqual([0, 0.5, 0, 0, 0, 0]);
    learned.stopAnimation("Flicker");
    learned.update(undefined, 1);
    factorsOf(learned).forEach((x, i) => expect(x).toBeCloseTo(i % 2 ? 0.5 : 0.3));
    learned.stopAnimation("Flicker");
  });

  it("goes by the clock unless it is told how much time has passed", async () => {
    const learned = new LearnedScene(await load(lampRoom()));
    learned.playAnimation("Flicker", { loop: false });
    learned.update();
    const start = performance.now();
    while (performance.now() - start < 50);
    learned.update();
    const [factor] = factorsOf(learned);
    expect(factor).toBeLessThan(0.976);
    expect(factor).toBeGreaterThanOrEqual(0);
  });

  it("is read as linear, step and cubic spline keys", () => {
    const track = { lamp: 0, path: "intensity", times: [1, 3], spline: false, step: false } as const;
    expect([0, 1, 1.5, 3, 9].map((time) => valuesAt({ ...track, values: [0, 4] }, time)[0])).toEqual([0, 0, 1, 4, 4]);
    expect([1, 2.9, 3].map((time) => valuesAt({ ...track, step: true, values: [0, 4] }, time)[0])).toEqual([0, 0, 4]);
    // Hermite between 0 and 4 with a leaving slope of 1 and an arriving one of −2, over 2 s, at a half: 2 + ⅛ · 2 · (1 + 2).
    const spline = { ...track, spline: true, values: [9, 0, 1, -2, 4, 9] };
    expect([1, 2, 3].map((time) => valuesAt(spline, time)[0])).toEqual([0, 2.75, 4]);
    // What swings below nothing is off.
    expect(valuesAt({ ...spline, values: [0, 0, -9, 0, 0, 0] }, 1.5)).toEqual([0]);
  });

  it("is there in files of lamps alone, and other animations are none", async () => {
    const plain = new LearnedScene(await load(lampRoom(FLICKER.slice(2))));
    expect(plain.animations).toEqual([]);
    expect(() => plain.playAnimation("Flicker")).toThrow("expected one of the animations");
    const { playing } = (await load(lampRoom(FLICKER.slice(2)))).userData.lightwell as LoadedLight;
    expect(playing).toBeNull();
  });

  it("comes with the light for a model that was loaded elsewhere", async () => {
    const { scene } = await load(lampRoom());
    const learned = await loadLight(lampRoom().slice().buffer, scene);
    learned.playAnimation("Flicker");
    learned.update();
    learned.update(undefined, 0.5);
    expect(factorsOf(learned)[0]).toBe(0.75);
  });

  const LAMP = "/extensions/LIGHTWELL_neural_radiance/";
  it.each([
    [change(0, { pointer: `${LAMP}lamps/2/intensity` }), "animations[0].channels[0]: expected one of 2 lamps, found 2"],
    [change(0, { pointer: `${LAMP}lamps/0/name` }), "animations[0].channels[0]: expected a pointer to the intensity or color of a lamp"],
    [change(0, { pointer: `${LAMP}exposure` }), "animations[0].channels[0]: expected a pointer"],
    [change(0, { pointer: `${LAMP}lamps/0/color` }), "animations[0].channels[0]: expected a value for each time"],
    [change(0, { values: [1, 2] }), "animations[0].channels[0]: expected a value for each time"],
    [change(0, { interpolation: "CUBICSPLINE" }), "animations[0].channels[0]: expected a value for each time"],
    [change(0, { times: [0, 2, 1] }), "animations[0].channels[0]: expected times that increase"],
    [change(0, { times: [-1, 0, 1] }), "animations[0].channels[0]: expected times that increase"],
    [change(1, { values: [0, 0, 0, 0, Number.NaN, 0] }), "animations[0].channels[1]: expected finite numbers"],
  ])("%# that is damaged is refused in one line", async (channels, message) => {
    await expect(load(lampRoom(channels))).rejects.toThrow(message);
  });

  it("are 64 at most", async () => {
    const many = lampRoom(FLICKER, 1, (json) => (json.animations = Array(65).fill(json.animations[0])));
    await expect(load(many)).rejects.toThrow("animations[64]: expected at most 64 animations of lamps");
  });
});

describe("a light of three.js that belongs to a lamp", () => {
  it("takes the lamp with it, by its share of the lamp's light", async () => {
    const gltf = await load(lampRoom());
    const bulb = gltf.scene.getObjectByName("Bulb") as PointLight;
    const learned = new LearnedScene(gltf);
    bulb.intensity = 0;
    learned.update();
    // 12 of 16 cd are left.
    expect(factorsOf(learned)).toEqual([0.75, 0.5, 0.75, 0.5, 0.75, 0.5]);
    bulb.intensity = 4;
    bulb.color.setRGB(0, 1, 1);
    learned.setLamp("desk", 2);
    learned.update();
    expect(factorsOf(learned)).toEqual([1.5, 0.5, 2, 0.5, 2, 0.5]);
    // What was the light's at first is remembered.
    learned.detach();
    learned.attach();
    learned.update();
    expect(factorsOf(learned)).toEqual([1.5, 0.5, 2, 0.5, 2, 0.5]);
    bulb.visible = false;
    learned.update();
    expect(factorsOf(learned)).toEqual([1.5, 0.5, 1.5, 0.5, 1.5, 0.5]);
  });

  it.each(["before", "after"])("follows an AnimationMixer that was made %s the scene", async (when) => {
    const gltf = await load(lampRoom());
    const tracks = [new NumberKeyframeTrack("Tube.intensity", [0, 1], [12, 0]), new ColorKeyframeTrack("Bulb.color", [0, 1], [1, 1, 1, 1, 0, 0])];
    const mixer = new AnimationMixer(gltf.scene);
    const start = () => mixer.clipAction(new AnimationClip("Lights", 1, tracks)).play();
    if (when === "before") start();
    const learned = new LearnedScene(gltf);
    if (when === "after") start();
    mixer.update(0.5);
    learned.update();
    // Red: 6 + 4 of 16 cd; green and blue: 6 + 2.
    expect(factorsOf(learned)).toEqual([0.625, 0.5, 0.5, 0.5, 0.5, 0.5]);
  });
});

describe("the learned picture", () => {
  const [WIDTH, HEIGHT] = [32, 24];
  const opened = openModule("renderers.ts", "ready");

  it.each(["webgl", "webgpu"] as const)("%s: follows the lamps that an animation sets", async (kind) => {
    const glb = Buffer.from(lampRoom(FLICKER, 0.1)).toString("base64");
    const camera = { position: CAMERA.position, target: CAMERA.target, fovY: CAMERA.fov_y } as Request["camera"];
    const draw = async (time: number): Promise<number[]> => {
      const request = { glb, kind, width: WIDTH, height: HEIGHT, camera, playing: { name: "Flicker", time } };
      const { data }: Answer = await opened.page.evaluate((asked) => window.draw(asked), request);
      const at = 4 * ((HEIGHT / 2) * WIDTH + WIDTH / 2);
      return data.slice(at, at + 3).map((x) => x / (WHITE[0] + 0.04));
    };
    // 0.1 of desk and 0.2 · ½ of bed, which is red from the first second on.
    for (const [time, expected] of [
      [0.5, [0.175, 0.175, 0.175]],
      [1.5, [0.125, 0.025, 0.025]],
    ] as const) {
      const found = await draw(time);
      found.forEach((x, c) => expect(Math.abs(x / expected[c]! - 1)).toBeLessThan(2e-3));
    }
  }, 120_000);
});
