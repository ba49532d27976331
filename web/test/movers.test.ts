/** Nodes of a file that move: what is read, where they stand, and what a field is told of them. */

import { AnimationClip, BoxGeometry, Group, type Material, Matrix4, Mesh, MeshStandardMaterial, QuaternionKeyframeTrack, Texture, Vector3, VectorKeyframeTrack } from "three";
import { describe, expect, it, vi } from "vitest";
import { type MoverRecord, readMovers } from "../runtime/src/mover-record.ts";
import { moverValuesText, readMoverValues } from "../runtime/src/mover-values.ts";
import { moverProp, moverProps, setMovers } from "../runtime/src/mover-props.ts";
import { Mover } from "../runtime/src/movers.ts";
import { toRestOf } from "../runtime/src/to-rest.ts";
import { readVariables } from "../runtime/src/variables.ts";

const DOOR = { name: "Door", kind: "node", node: 1, path: "rotation", axis: [0, 1, 0], range: [0, 90], unit: "degrees", initial: 45 };
const LIGHT = { name: "lamp", kind: "point", low: [0, 0, 0], high: [1, 1, 1], clearance: 0.1, initial: [0, 0, 0], intensity: 1, color: [1, 1, 1] };

const CLIP = { name: "Open", kind: "clip", animation: 0, range: [0, 1], unit: "share", initial: 0 };
const FILE = {
  nodes: [{}, {}],
  animations: [{ channels: [{ target: { node: 1, path: "rotation" } }, { target: { node: 0, path: "translation" } }, { target: { node: 1 } }] }],
};

const read = (...entries: unknown[]): MoverRecord[] => readMovers(entries, "variables", FILE);

describe("reading", () => {
  it("tells lights from nodes", () => {
    expect(readVariables([LIGHT, DOOR], "variables")).toHaveLength(1);
    expect(read(LIGHT, DOOR)).toMatchObject([{ name: "Door", node: 1, range: [0, 90], offset: [0, 0, 0] }]);
    expect(read(LIGHT)).toEqual([]);
  });

  it.each([
    [{ node: 2 }, "node"],
    [{ path: "scale" }, "path"],
    [{ unit: "metres" }, "unit"],
    [{ range: [5, 5] }, "range"],
    [{ range: [0] }, "range"],
    [{ initial: 91 }, "initial"],
    [{ axis: [0, 0, 0] }, "axis"],
  ])("refuses %j", (change, where) => {
    expect(() => read({ ...DOOR, ...change })).toThrow(`variables[0].${where}`);
  });

  it("refuses lights behind what moves", () => {
    expect(() => read(DOOR, LIGHT)).toThrow("lights come before what moves");
  });

  it("reads clips with the nodes that they move", () => {
    expect(read(LIGHT, DOOR, CLIP)).toMatchObject([{ name: "Door" }, { name: "Open", animation: 0, nodes: [1, 0], unit: "share" }]);
    expect(readVariables([LIGHT, CLIP], "variables")).toHaveLength(1);
    expect(() => read({ ...CLIP, animation: 1 })).toThrow("variables[0].animation");
    expect(() => read({ ...CLIP, range: [0, 2] })).toThrow("variables[0].range");
    expect(() => readMovers([CLIP], "variables", { ...FILE, animations: [{ channels: [{ target: { node: 2 } }] }] })).toThrow("animations[0].channels[0].target.node");
  });
});

/** A leaf whose node stands at x = 2, in a root that is turned and scaled; it shares its material with a wall. */
function house(record = read(DOOR)[0]!) {
  const material = new MeshStandardMaterial();
  const [wall, leaf] = [new Mesh(new BoxGeometry(), material), new Mesh(new BoxGeometry(), material)];
  const node = new Group();
  node.position.set(2, 0, 0);
  leaf.position.set(-2, 0, 0);
  node.add(leaf);
  const root = new Group();
  root.rotation.z = 0.3;
  root.scale.setScalar(2);
  root.add(wall, node);
  return { mover: new Mover(record, [node], root), root, wall, leaf, material };
}

describe("a mover", () => {
  it("turns its node about its own origin, and says where surfaces rest", () => {
    const { mover, root, leaf } = house();
    mover.value = 90;
    expect(mover.follow(root)).toBe(true);
    expect(mover.follow(root)).toBe(false);
    // In the space of the root the origin is at (2, 0, 2) now: 2 behind the hinge.
    const now = root.worldToLocal(leaf.localToWorld(new Vector3()));
    expect(now.distanceTo(new Vector3(2, 0, 2))).toBeLessThan(1e-6);
    expect(now.applyMatrix4(toRestOf(leaf.material as MeshStandardMaterial)).length()).toBeLessThan(1e-6);
    expect(mover.pose).toBe(1);
  });

  it("has a material of its own where the wall has the same", () => {
    const { wall, leaf, material } = house();
    expect(wall.material).toBe(material);
    expect(leaf.material).not.toBe(material);
    expect(toRestOf(material).equals(new Matrix4())).toBe(true);
  });

  it("has what belongs to a material that it copies: its light map, and the hooks and nodes of its owner", () => {
    const material = new MeshStandardMaterial();
    const own = { onBeforeCompile: () => {}, colorNode: {} };
    Object.assign(material, own);
    material.addEventListener("dispose", () => {});
    const [wall, leaf] = [new Mesh(new BoxGeometry(), material), new Mesh(new BoxGeometry(), material)];
    const lightmap = { index: 0, texCoord: 1, intensity: 2, map: new Texture(), bytes: 0 };
    const lightmaps = new Map([[material as Material, lightmap]]);
    new Mover(read(DOOR)[0]!, [leaf], new Group().add(wall, leaf), null, lightmaps);
    expect(leaf.material).not.toBe(material);
    expect(lightmaps.get(leaf.material)).toBe(lightmap);
    expect(leaf.material).toMatchObject(own);
    expect("_listeners" in leaf.material).toBe(false);
  });

  it("says where surfaces rest whichever scene of one root is shown: React's StrictMode makes two, and keeps the first", () => {
    const { mover, root, leaf } = house();
    new Mover(mover.record, [mover.object], root);
    mover.value = 90;
    mover.follow(root);
    const now = root.worldToLocal(leaf.localToWorld(new Vector3()));
    expect(now.applyMatrix4(toRestOf(leaf.material as MeshStandardMaterial)).length()).toBeLessThan(1e-6);
  });

  it("stays in its range and goes back", () => {
    const { mover, root, leaf } = house();
    mover.value = 400;
    expect(mover.value).toBe(90);
    mover.value = Number.NaN;
    expect(mover.value).toBe(90);
    mover.follow(root);
    mover.restore();
    expect(root.worldToLocal(leaf.localToWorld(new Vector3())).length()).toBeLessThan(1e-6);
  });

  it("slides along its axis from its offset", () => {
    const slide = { ...DOOR, path: "translation", unit: "metres", range: [0, 2], offset: [0, 1, 0], axis: [0, 0, 1], initial: 0.5 };
    const { mover, root, leaf } = house(read(slide)[0]!);
    mover.follow(root);
    expect(root.worldToLocal(leaf.localToWorld(new Vector3())).distanceTo(new Vector3(0, 1, 0.5))).toBeLessThan(1e-6);
    expect(mover.pose).toBe(0.25);
  });
});

describe("a clip", () => {
  const leaves = () => {
    const material = new MeshStandardMaterial();
    const nodes = ["left", "right"].map((name) => Object.assign(new Group(), { name }));
    const meshes = nodes.map((node) => {
      const mesh = new Mesh(new BoxGeometry(), material);
      node.add(mesh);
      return mesh;
    });
    const root = new Group();
    root.position.x = 5;
    root.add(...nodes);
    const tracks = [
      new VectorKeyframeTrack("left.position", [0, 1, 2], [0, 0, 0, 1, 0, 0, 1, 0, 0]),
      new QuaternionKeyframeTrack("right.quaternion", [0, 2], [0, 0, 0, 1, 0, Math.SQRT1_2, 0, Math.SQRT1_2]),
    ];
    return { mover: new Mover(read(CLIP)[0]!, nodes, root, new AnimationClip("Open", 2, tracks)), root, nodes, meshes };
  };

  it("is shown at the share of its time that the value says, its last one included", () => {
    const { mover, root, nodes } = leaves();
    for (const [value, x, turn] of [
      [0.25, 0.5, Math.PI / 8],
      [1, 1, Math.PI / 2],
      [0.5, 1, Math.PI / 4],
      [0, 0, 0],
    ] as const) {
      mover.value = value;
      mover.follow(root);
      expect(nodes[0]!.position.x).toBeCloseTo(x, 5);
      expect(2 * Math.acos(Math.min(nodes[1]!.quaternion.w, 1))).toBeCloseTo(turn, 2);
      expect(mover.pose).toBe(value);
    }
  });

  it("says of each part where it rests, and puts all back", () => {
    const { mover, root, nodes, meshes } = leaves();
    mover.value = 1;
    mover.follow(root);
    for (const mesh of meshes) {
      const now = root.worldToLocal(mesh.localToWorld(new Vector3(1, 0, 0)));
      expect(now.applyMatrix4(toRestOf(mesh.material as MeshStandardMaterial)).distanceTo(new Vector3(1, 0, 0))).toBeLessThan(1e-6);
    }
    expect(meshes[0]!.material).not.toBe(meshes[1]!.material);
    mover.restore();
    expect([nodes[0]!.position.x, nodes[1]!.quaternion.w]).toEqual([0, 1]);
  });
});

describe("values in a text", () => {
  it("are read and written by name", () => {
    expect([...readMoverValues("Front%20Door:45;Slide:0.6;bad;:3;x:")]).toEqual([
      ["Front Door", 45],
      ["Slide", 0.6],
    ]);
    const { mover } = house();
    expect(moverValuesText([mover])).toBe("");
    mover.value = 30;
    expect(moverValuesText([mover])).toBe("Door:30");
  });
});

describe("short forms", () => {
  const mover = (name: string, range = [0, 90]) => house(read({ ...DOOR, name, range, initial: range[0] })[0]!).mover;

  it("are names in lower case that attributes can have", () => {
    const names = ["Door", "Sliding door.001", "Tür", "--"].map(moverProp);
    expect(names).toEqual(["door", "sliding-door-001", "tür", ""]);
  });

  it("are refused in one line where they are taken", () => {
    const said = vi.spyOn(console, "warn").mockImplementation(() => {});
    const [door, again, light, none] = [mover("Door"), mover("door"), mover("Light"), mover("!")];
    const found = moverProps([door, again, light, none], (prop) => prop === "light", "LearnedScene");
    expect([...found]).toEqual([["door", door]]);
    expect(said.mock.calls.flat()).toEqual([
      "LearnedScene: 'door' has no short form, because 'door' is taken; set it through 'movers', or rename its node",
      "LearnedScene: 'Light' has no short form, because 'light' is taken; set it through 'movers', or rename its node",
      "LearnedScene: '!' has no short form, because '' is no name; set it through 'movers', or rename its node",
    ]);
    said.mockRestore();
  });

  it("win over values, and lie on ranges that run down too", () => {
    const [down, up, rest] = [mover("Down", [40, -20]), mover("Up"), mover("Rest", [10, 20])];
    setMovers([down, up, rest], (name) => ({ Down: 0, Up: 30 })[name], new Map([[down, 0.5]]));
    expect([down.value, up.value, rest.value]).toEqual([10, 30, 10]);
    setMovers([down, up, rest], () => undefined, new Map([[rest, 7]]));
    expect([down.value, up.value, rest.value]).toEqual([40, 0, 20]);
  });
});
