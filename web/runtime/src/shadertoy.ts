/** Wraps a printed field into a Shadertoy: a flat card (or a slice through space) that the mouse lights and tilts. */

import type { Graph } from "./graph/index.ts";
import { literal } from "./graph/language.ts";

/** Shadertoy refuses longer texts. */
const MAX_CHARACTERS = 65_536;

/** GLSL of every input of a field on the card; `card` is 0 … 1 from the top left, `mouse` 0 … 1 too. */
const INPUTS: Readonly<Record<string, string>> = {
  position: "position",
  normal: "vec3(0.0, 0.0, 1.0)",
  view: "normalize(vec3(0.5 - card.x, card.y - 0.5, 1.5))",
  light: "mix(LOW, HIGH, vec3(mouse, 0.5))",
  reflectance: "vec3(REFLECTANCE)",
  roughness: "ROUGHNESS",
  metallic: "0.0",
  shading_normal: "vec3(0.0, 0.0, 1.0)",
  uv: "card",
  uv1: "card",
};

/** The whole text for the tab "Image". */
export function shadertoy(
  graph: Graph,
  name: string,
  field: string,
  bounds: { readonly low: readonly number[]; readonly high: readonly number[] } = { low: [-1, -1, -1], high: [1, 1, 1] },
): string {
  const vec3 = (numbers: readonly number[]) => `vec3(${numbers.map(literal).join(", ")})`;
  const call = [...graph.inputs.keys()].map((input) => INPUTS[input]!).join(", ");
  const text = `${field}
// What stands around the field. Drag the mouse to move the light.
const vec3 LOW = ${vec3(bounds.low)};
const vec3 HIGH = ${vec3(bounds.high)};
const float DEPTH = 0.5;       // where the slice lies between LOW.z and HIGH.z
const float REFLECTANCE = 0.8;
const float ROUGHNESS = 0.5;
const float EXPOSURE = 1.0;

void mainImage(out vec4 color, in vec2 pixel) {
  vec2 card = pixel / iResolution.xy;
  vec2 mouse = iMouse.z > 0.0 ? iMouse.xy / iResolution.xy : 0.5 + 0.3 * vec2(cos(iTime), sin(iTime));
  vec3 position = mix(LOW, HIGH, vec3(card, DEPTH));
  card.y = 1.0 - card.y;
  vec3 radiance = EXPOSURE * REFLECTANCE * max(${name}(${call}), 0.0);
  vec3 tone = radiance / (1.0 + radiance);
  color = vec4(mix(12.92 * tone, 1.055 * pow(tone, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, tone)), 1.0);
}
`;
  if (text.length <= MAX_CHARACTERS) return text;
  return `// ${text.length} characters: Shadertoy takes ${MAX_CHARACTERS}.\n${text}`;
}
