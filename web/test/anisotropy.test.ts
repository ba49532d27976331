/** Textures of materials are filtered along surfaces that are seen at a grazing angle. */

import { filterAnisotropically } from "lightwell";
import { Group, Mesh, MeshStandardMaterial, Object3D, Texture } from "three";
import { describe, expect, it } from "vitest";

describe("filterAnisotropically", () => {
  it("raises what textures ask for, in lists of materials too, and lowers nothing", () => {
    const [plain, sharp, rough] = [new Texture(), new Texture(), new Texture()];
    sharp.anisotropy = 16;
    const root = new Group();
    const listed = new Mesh(undefined, [new MeshStandardMaterial({ map: sharp }), new MeshStandardMaterial({ roughnessMap: rough })]);
    root.add(new Object3D(), new Mesh(undefined, new MeshStandardMaterial({ map: plain })), listed);
    filterAnisotropically(root);
    expect([plain, sharp, rough].map((texture) => texture.anisotropy)).toEqual([8, 16, 8]);
  });
});
