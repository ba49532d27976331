/** The scenes of the tests. */

import { ball, box, type Fixture, type FixtureField, type FixtureMesh, matte, quad } from "./glb.ts";

/** The declared light of the fixtures. */
export const LAMP = {
  name: "light",
  kind: "point",
  low: [-0.8, 0.2, -0.8],
  high: [0.8, 1.8, 0.8],
  clearance: 0.05,
  radius: 0,
  initial: [0, 1.6, 0],
  intensity: 4,
  color: [1, 0.9, 0.8],
};

/** A room of 2 m: floor, ceiling, back wall, red left and green right wall; open to +z. */
export function room(): FixtureMesh[] {
  return [
    quad(0, [-1, 0, 1], [2, 0, 0], [0, 0, -2]),
    quad(0, [-1, 2, -1], [2, 0, 0], [0, 0, 2]),
    quad(0, [-1, 0, -1], [2, 0, 0], [0, 2, 0]),
    quad(1, [-1, 0, 1], [0, 0, -2], [0, 2, 0]),
    quad(2, [1, 0, -1], [0, 0, 2], [0, 2, 0]),
  ];
}

export const WHITE = [0.73, 0.73, 0.73] as const;
export const MATERIALS = [matte(...WHITE), matte(0.63, 0.07, 0.05), matte(0.12, 0.45, 0.09)];

/** radiance = W · (position, light) + b. */
export const LINEAR = {
  weights: [
    [0.02, 0.01, -0.01, 0.005, 0.0, 0.01],
    [-0.01, 0.02, 0.01, 0.0, 0.01, 0.0],
    [0.01, -0.01, 0.02, 0.01, 0.0, 0.0],
  ],
  bias: [0.08, 0.07, 0.06],
};

/** The closed form of `linearField`. */
export function linearRadiance(position: readonly number[], light: readonly number[]): number[] {
  const input = [...position, ...light];
  return LINEAR.weights.map((row, i) => row.reduce((sum, w, k) => sum + w * input[k]!, LINEAR.bias[i]!));
}

export function linearField(): FixtureField {
  return {
    name: "indirect",
    role: "indirect",
    variable: 0,
    graph: {
      version: 1,
      inputs: { position: 3, light: 3 },
      buffers: {
        w: { shape: [3, 6], type: "float32", values: LINEAR.weights.flat() },
        b: { shape: [3], type: "float32", values: LINEAR.bias },
      },
      nodes: [
        { id: "x", op: "concat", inputs: ["position", "light"] },
        { id: "y", op: "linear", inputs: ["x"], weights: "w", bias: "b" },
      ],
      outputs: { radiance: "y" },
    },
  };
}

/** The scene's own light, everywhere the same. */
export const STILL = [0.05, 0.04, 0.03];

export function stillField(): FixtureField {
  return {
    name: "lamps",
    role: "static",
    graph: {
      version: 1,
      inputs: { position: 3 },
      nodes: [{ id: "y", op: "affine", inputs: ["position"], scale: [0, 0, 0], offset: STILL }],
      outputs: { radiance: "y" },
    },
  };
}

/** The empty room with a linear field. */
export function plainRoom(change: Partial<Fixture> = {}): Fixture {
  return { meshes: room(), materials: MATERIALS, variables: [LAMP], fields: [linearField()], ...change };
}

/** A room with two boxes and a ball. */
export function furnishedRoom(change: Partial<Fixture> = {}): Fixture {
  const meshes = [
    ...room(),
    ...box(0, [-0.35, 0.6, -0.35], [0.55, 1.2, 0.55], 0.3),
    ...box(0, [0.4, 0.2, 0.3], [0.5, 0.4, 0.5], -0.3),
    ball(3, [0.4, 0.6, 0.3], 0.2),
  ];
  const glossy = {
    pbrMetallicRoughness: { baseColorFactor: [0.9, 0.7, 0.4, 1], metallicFactor: 1, roughnessFactor: 0.35 },
  };
  return plainRoom({ meshes, materials: [...MATERIALS, glossy], ...change });
}

/** The camera of the fixtures. */
export const CAMERA = { position: [0, 1, 4.2], target: [0, 1, 0], up: [0, 1, 0], fov_y: 36 };
