/** Nodes of a file that move: what is read, where they stand, and what a field is told of them. */

import { BoxGeometry, Group, Matrix4, Mesh, MeshStandardMaterial, Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { type MoverRecord, readMovers } from "../runtime/src/mover-record.ts";
import { moverValuesText, readMoverValues } from "../runtime/src/mover-values.ts";
import { Mover } from "../runtime/src/movers.ts";
import { toRestOf } from "../runtime/src/to-rest.ts";
import { readVariables } from "../runtime/src/variables.ts";

const DOOR = { name: "Door", kind: "node", node: 1, path: "rotation", axis: [0, 1, 0], range: [0, 90], unit: "degrees", initial: 45 };
const LIGHT = { name: "lamp", kind: "point", low: [0, 0, 0], high: [1, 1, 1], clearance: 0.1, initial: [0, 0, 0], intensity: 1, color: [1, 1, 1] };

const read = (...entries: unknown[]): MoverRecord[] => readMovers(entries, "variables", 2);

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

  it("refuses lights behind nodes", () => {
    expect(() => read(DOOR, LIGHT)).toThrow("lights come before nodes");
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
  return { mover: new Mover(record, node, root), root, wall, leaf, material };
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
