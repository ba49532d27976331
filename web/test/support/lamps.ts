/** A room whose own lamps have switches: a field of two lamps, lights of the file, animations. */

import { plainRoom } from "./fixtures.ts";
import { type FixtureField, writeGlb } from "./glb.ts";

/** A field whose radiance is the sum over lamps k of the factors of lamp k times (k + 1) · scale. */
export function lampsField(scale = 1): FixtureField {
  const frame = { per_frame: true };
  const layer = (channel: number) => [
    { id: `f${channel}`, op: "slice", inputs: ["lamps"], start: 2 * channel, width: 2, ...frame },
    { id: `m${channel}`, op: "linear", inputs: [`f${channel}`], weights: "w", bias: "b", ...frame },
  ];
  return {
    role: "static",
    graph: {
      version: 1,
      inputs: { position: 3, lamps: 6 },
      buffers: { w: { shape: [1, 2], type: "float32", values: [scale, 2 * scale] }, b: { shape: [1], type: "float32", values: [0] } },
      nodes: [
        ...[0, 1, 2].flatMap(layer),
        { id: "m", op: "concat", inputs: ["m0", "m1", "m2"], ...frame },
        { id: "zero", op: "affine", inputs: ["position"], scale: [0, 0, 0], offset: [0, 0, 0] },
        { id: "y", op: "add", inputs: ["zero", "m"] },
      ],
      outputs: { radiance: "y" },
    },
  };
}

/** A channel of an animation. */
export interface Channel {
  readonly pointer: string;
  readonly times: readonly number[];
  readonly values: readonly number[];
  readonly interpolation?: string;
  readonly width?: 1 | 3;
}

const LAMPS = "/extensions/LIGHTWELL_neural_radiance/lamps/";

/** Lamp 0 falls from 1 over ½ to 0 within two seconds; lamp 1 turns from white to red at once. */
export const FLICKER: readonly Channel[] = [
  { pointer: `${LAMPS}0/intensity`, times: [0, 1, 2], values: [1, 0.5, 0] },
  { pointer: `${LAMPS}1/color`, times: [0, 1], values: [1, 1, 1, 1, 0, 0], interpolation: "STEP", width: 3 },
  { pointer: "/materials/0/emissiveFactor", times: [0, 1], values: [0, 0, 0, 1, 1, 1], width: 3 },
];

/**
 * A file with the lamps `desk` (a light of 4 cd and one of 12 cd, called Bulb and Tube) and `bed` (at a half, no light), and an
 * animation called Flicker.
 */
export function lampRoom(channels: readonly Channel[] = FLICKER, scale = 1, tamper: (json: any) => void = () => {}): Uint8Array<ArrayBuffer> {
  return writeGlb(
    plainRoom({
      variables: [],
      fields: [lampsField(scale)],
      numbers: channels.flatMap(({ times, values, width }) => [
        { values: times, type: "SCALAR" },
        { values, type: width === 3 ? "VEC3" : "SCALAR" },
      ]),
      tamper: (json: any) => {
        const lamps = [
          { name: "desk", nodes: ["Bulb", "Tube"], intensity: 1, color: [1, 1, 1] },
          { name: "bed", nodes: [], intensity: 0.5, color: [1, 1, 1] },
        ];
        Object.assign(json.extensions.LIGHTWELL_neural_radiance, { version: 2, lamps });
        const lights = [4, 12].map((intensity) => ({ type: "point", intensity }));
        json.extensions.KHR_lights_punctual = { lights };
        json.extensionsUsed.push("KHR_lights_punctual", "KHR_animation_pointer");
        ["Bulb", "Tube"].forEach((name, light) => {
          json.scenes[0].nodes.push(json.nodes.length);
          json.nodes.push({ name, extensions: { KHR_lights_punctual: { light } } });
        });
        json.animations = [animation(json, channels)];
        tamper(json);
      },
    }),
  );
}

function animation(json: any, channels: readonly Channel[]) {
  const first = json.accessors.length - 2 * channels.length;
  return {
    name: "Flicker",
    samplers: channels.map(({ interpolation }, i) => ({ input: first + 2 * i, output: first + 2 * i + 1, ...(interpolation ? { interpolation } : {}) })),
    channels: channels.map(({ pointer }, sampler) => ({ sampler, target: { path: "pointer", extensions: { KHR_animation_pointer: { pointer } } } })),
  };
}
