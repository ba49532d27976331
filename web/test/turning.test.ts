/** An environment map that turns: read, turned, drawn behind the scene. */

import { angleInRange, angleOf, type Environment, FormatError, northAt, readExtension, SkyBackground, turningOf, type TurningVariable } from "lightwell";
import { Color, DataUtils, Group, Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { TurningLamp } from "../runtime/src/turning-lamp.ts";
import { EngineLight } from "../runtime/src/engines/engine-light.ts";
import { readVariables, type Variable } from "../runtime/src/variables.ts";

const MAP = { kind: "environment", name: "environment", range: [-30, 300], initial: [0, 0, -1], intensity: 2, color: [1, 0.5, 1] };
const read = (changed: object = {}): Variable[] => readVariables([{ ...MAP, ...changed }], "variables");
const lamp = (changed: object = {}) => new TurningLamp(read(changed)[0] as TurningVariable, new Group());

describe("the variable", () => {
  it("is read; its angle is that of the direction of the map's north", () => {
    const [variable] = read() as [TurningVariable];
    expect(variable).toMatchObject({ kind: "environment", range: [-30, 300], initial: [0, 0, -1], intensity: 2 });
    // As `lightwell.scenes.turning` has it: 90 degrees are +X.
    expect(northAt(90)[0]).toBeCloseTo(1, 9);
    for (const angle of [-29, 0, 90, 181, 299]) expect(angleOf(variable, northAt(angle))).toBeCloseTo(angle, 6);
    // Beside the range the nearest end.
    expect([angleOf(variable, northAt(310)), angleOf(variable, northAt(325))]).toEqual([300, -30]);
    expect([angleInRange(variable, 330), angleInRange(variable, 315), angleInRange(variable, -90)]).toEqual([-30, null, 270]);
    expect(angleOf({ range: [0, 360] }, northAt(360))).toBe(0);
  });

  it.each([
    [{ range: [0] }, "variables[0].range: expected two increasing angles"],
    [{ range: [90, 0] }, "variables[0].range: expected two increasing angles"],
    [{ range: [-90, 300] }, "at most 360 degrees apart"],
    [{ range: [0, 400] }, "variables[0].range[1]: expected a number in"],
    [{ sky: {} }, "variables[0].sky: expected nothing of that name in an environment"],
    [{ kind: "moon" }, 'variables[0].kind: expected "point", "sun" or "environment"'],
  ])("refuses %j", (changed, message) => {
    expect(() => read(changed)).toThrow(FormatError);
    expect(() => read(changed)).toThrow(message);
  });

  it("is of version 2, the only one of its kind, and refused where no map is drawn", async () => {
    const sources = { bufferView: async () => new ArrayBuffer(0), texture: async () => ({ source: null, width: 1, height: 1 }) };
    const extension = { version: 1, variables: [MAP], fields: [] };
    await expect(readExtension({ extensions: { LIGHTWELL_neural_radiance: extension } } as never, sources)).rejects.toThrow("in version 1");
    expect(() => readVariables([MAP, { ...MAP, name: "other" }], "variables")).toThrow("variables: expected one environment that turns");
    const radiance = { variables: read(), movers: [], lamps: [], fields: [], probes: [], exposure: null, core: null, environment: null };
    expect(() => new EngineLight(radiance)).toThrow("environment 'environment': expected one that stands still");
  });
});

describe("the lamp", () => {
  it("tells its field where the map's north is, and follows its three.js light", () => {
    const map = lamp();
    expect(turningOf([map])).toBe(map);
    expect(map.move(new Vector3(...northAt(90)))).toBe(false);
    expect(map.angle).toBeCloseTo(90, 6);
    expect(map.move(new Vector3(...northAt(310)))).toBe(true);
    map.object.rotation.set(0, -Math.PI / 4, 0);
    map.object.intensity = 3;
    map.object.color.set(0, 1, 0);
    map.follow();
    expect(map.angle).toBeCloseTo(45, 6);
    expect([map.intensity, map.color.getHex()]).toEqual([3, 0x00ff00]);
    expect(map.object.visible).toBe(false);
  });
});

describe("the picture behind the scene", () => {
  const width = 8;
  const texels = Float32Array.from({ length: 3 * width * 4 }, (_, i) => Math.floor(i / 3) % width);
  const environment: Environment = { radiance: [1, 1, 1], picture: { width, height: 4, texels }, lamp: null };
  const row = (sky: SkyBackground) => Array.from({ length: width }, (_, k) => DataUtils.fromHalfFloat((sky.texture.image.data as unknown as Uint16Array)[4 * k]!));

  it("turns by columns clockwise, between two of them as well, with the intensity of its light", () => {
    const [sky, map] = [new SkyBackground(environment), lamp({ range: [0, 360], intensity: 1, color: [1, 1, 1] })];
    expect(sky.update([map])).toBe(true);
    expect(row(sky)).toEqual([0, 1, 2, 3, 4, 5, 6, 7]);
    map.move(new Vector3(...northAt(90)));
    // What was seen in a column is seen a quarter of the picture on: columns grow from north to east.
    expect(sky.update([map])).toBe(true);
    row(sky).forEach((x, k) => expect(x).toBeCloseTo((k + 6) % 8, 2));
    map.move(new Vector3(...northAt(22.5)));
    sky.update([map]);
    expect(row(sky)[4]).toBeCloseTo(3.5, 2);
    map.intensity = 2;
    map.color.copy(new Color(0.5, 1, 1));
    // Light that stands still is another one.
    expect(sky.update([map], false)).toBe(true);
    expect(row(sky)[4]).toBeCloseTo(3.5, 2);
    expect(sky.update([map], false)).toBe(false);
  });
});
