/** Switches of the scene's own lamps: reading, factors, surfaces that follow, texts of links. */

import { LightwellLoaderPlugin, lampSettingsText, parseLearned, readLampSettings } from "lightwell";
import { type Material, Matrix4, Mesh, MeshStandardMaterial, Object3D } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { describe, expect, it } from "vitest";
import { LearnedField } from "../runtime/src/learned-field.ts";
import type { Lightmap, LoadedLight } from "../runtime/src/loaded-light.ts";
import { type LampRecord, Switches } from "../runtime/src/switches.ts";
import { TO_REST, toRestOf } from "../runtime/src/to-rest.ts";
import { plainRoom } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";
import { lampsField } from "./support/lamps.ts";

const LAMPS: LampRecord[] = [
  { name: "desk", nodes: ["Desk lamp"], intensity: 1, color: [1, 1, 1] },
  { name: "bed", nodes: [], intensity: 0.5, color: [1, 0.5, 0] },
];

function load(change: (extension: Record<string, unknown>) => void = () => {}, fields = [lampsField()]) {
  const tamper = (json: { [key: string]: any }) => {
    const extension = json.extensions.LIGHTWELL_neural_radiance;
    Object.assign(extension, { version: 2, lamps: structuredClone(LAMPS) });
    change(extension);
  };
  const bytes = writeGlb(plainRoom({ fields, tamper })).slice().buffer;
  return parseLearned(new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser)), bytes);
}

describe("a file with lamps", () => {
  it("is read, in version 2 alone", async () => {
    const { lamps, fields } = (await load()).userData.lightwell as LoadedLight;
    expect(lamps).toEqual(LAMPS);
    expect(fields[0]!.graph.inputs.get("lamps")).toBe(6);
    await expect(load((extension) => (extension.version = 1))).rejects.toThrow(/lamps: expected nothing of that name in version 1/);
    await expect(load((extension) => (extension.version = 3))).rejects.toThrow(/version: expected 1 or 2/);
    await expect(load((extension) => (extension.lamps = [LAMPS[0]]))).rejects.toThrow(/inputs\.lamps: expected an input of a surface/);
    await expect(load((extension) => (extension.lamps = [LAMPS[0], LAMPS[0]]))).rejects.toThrow(/lamps of different names/);
  });

  it("may use its lamps in per-frame nodes alone", async () => {
    const field = lampsField();
    delete (field.graph.nodes as Record<string, unknown>[])[0]!.per_frame;
    await expect(load(() => {}, [field])).rejects.toThrow(/per_frame: expected true, because 'lamps' is an input/);
  });

  it("has per-frame values that follow the dimmers", async () => {
    const { fields } = (await load()).userData.lightwell as LoadedLight;
    class Probe extends LearnedField {
      get values() {
        return [...this.frameValues.subarray(0, 3)];
      }
    }
    const field = new Probe(fields[0]!, "f", ["radiance"], "inline");
    field.follow([new (await import("three")).Vector3()]);
    const switches = new Switches(LAMPS);
    field.update(switches.factors);
    // 1 · (1, 1, 1) + 2 · ½ · (1, ½, 0)
    expect(field.values).toEqual([2, 1.5, 1]);
    switches.set("bed", 0);
    switches.set("desk", { intensity: 2, color: [1, 0, 0] });
    switches.follow();
    field.update(switches.factors);
    expect(field.values).toEqual([2, 0, 0]);
    expect(() => switches.set("sofa", 1)).toThrow(/expected a lamp of the file \('desk', 'bed'\), found 'sofa'/);
  });
});

describe("surfaces that shine", () => {
  it("follow their lamp with a material of their own", () => {
    const shared = new MeshStandardMaterial({ emissive: 0xffffff });
    const [lamp, other] = [new Mesh(undefined, shared), new Mesh(undefined, shared)];
    lamp.userData.name = "Desk lamp";
    const root = new Object3D().add(lamp, other);
    const switches = new Switches(LAMPS);
    switches.attach(root, new Map());
    switches.set("desk", 0.25);
    switches.follow();
    expect((lamp.material as MeshStandardMaterial).emissive.r).toBeCloseTo(0.25);
    expect(other.material).toBe(shared);
    expect(shared.emissive.r).toBe(1);
    expect(switches.of(lamp)!.name).toBe("desk");
    expect(switches.of(other)).toBeNull();
    switches.detach();
    expect(lamp.material).toBe(shared);
  });

  it("keep what their owner has given them since", () => {
    const lamp = new Mesh(undefined, new MeshStandardMaterial({ emissive: 0xffffff }));
    lamp.userData.name = "Desk lamp";
    const switches = new Switches(LAMPS);
    switches.attach(new Object3D().add(lamp), new Map());
    const painted = (lamp.material = new MeshStandardMaterial());
    switches.detach();
    expect(lamp.material).toBe(painted);
  });

  it("have the light maps of their materials for as long as they follow it, and hooks of their owner", () => {
    const material = new MeshStandardMaterial({ emissive: 0xffffff });
    const onBeforeCompile = (material.onBeforeCompile = () => {});
    const lamp = new Mesh(undefined, material);
    lamp.userData.name = "Desk lamp";
    const lightmaps = new Map([[material as Material, {} as Lightmap]]);
    const switches = new Switches(LAMPS);
    switches.attach(new Object3D().add(lamp), lightmaps);
    expect(lightmaps.get(lamp.material)).toBe(lightmaps.get(material));
    expect(lamp.material.onBeforeCompile).toBe(onBeforeCompile);
    switches.detach();
    expect(lightmaps.size).toBe(1);
  });

  it("that move know where they rest", () => {
    const lamp = new Mesh(undefined, new MeshStandardMaterial({ emissive: 0xffffff }));
    lamp.userData.name = "Desk lamp";
    const toRest = new Matrix4().makeTranslation(1, 2, 3);
    TO_REST.set(lamp.material, toRest);
    new Switches(LAMPS).attach(new Object3D().add(lamp), new Map());
    // The same matrix: it follows what moves.
    expect(toRestOf(lamp.material)).toBe(toRest);
  });
});

describe("the text of settings", () => {
  it("comes back as it was", () => {
    const { all } = new Switches([...LAMPS, { name: "a:b;c", nodes: [], intensity: 1, color: [1, 1, 1] }]);
    expect(lampSettingsText(all)).toBe("");
    all[0]!.set(0.3);
    all[2]!.set({ intensity: 0, color: "#ff8000" });
    const text = lampSettingsText(all);
    expect(text).toBe("desk:0.3;a%3Ab%3Bc:0:ff8000");
    expect([...readLampSettings(text)]).toEqual([
      ["desk", 0.3],
      ["a:b;c", { intensity: 0, color: "#ff8000" }],
    ]);
  });

  it("leaves out what is malformed", () => {
    expect([...readLampSettings("desk:-1;bed:x;:1;sofa:1:red;bath:0.5")]).toEqual([["bath", 0.5]]);
    expect([...readLampSettings(null)]).toEqual([]);
  });
});
