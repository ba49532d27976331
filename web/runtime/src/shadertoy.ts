/** Wraps a printed field into a Shadertoy: a flat card (or a slice through space) that the mouse lights and tilts. */

import { fail } from "./checks.ts";
import type { Graph } from "./graph/index.ts";
import { literal } from "./graph/language.ts";

/** Shadertoy refuses longer texts. */
const MAX_CHARACTERS = 65_536;

/** GLSL of the inputs of a field on the card; `card` is 0 … 1 from the top left, `mouse` 0 … 1 too. What moves is at rest. */
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
  rest_position: "position",
  rest_normal: "vec3(0.0, 0.0, 1.0)",
};

function inputOf([name, width]: [string, number]): string {
  if (name === "pose" && width <= 4) return width === 1 ? "POSE" : `vec${width}(POSE)`;
  return INPUTS[name] ?? fail("shadertoy", `a field without the input '${name}'; export glsl instead`);
}

/** The whole text for the tab "Image". */
export function shadertoy(
  graph: Graph,
  name: string,
  field: string,
  bounds: { readonly low: readonly number[]; readonly high: readonly number[] } = { low: [-1, -1, -1], high: [1, 1, 1] },
): string {
  const vec3 = (numbers: readonly number[]) => `vec3(${numbers.map(literal).join(", ")})`;
  const call = [...graph.inputs].map(inputOf).join(", ");
  const text = `${field}
// What stands around the field. Drag the mouse to move the light.
const vec3 LOW = ${vec3(bounds.low)};
const vec3 HIGH = ${vec3(bounds.high)};
const float DEPTH = 0.5;       // where the slice lies between LOW.z and HIGH.z
const float REFLECTANCE = 0.8;
const float ROUGHNESS = 0.5;
const float EXPOSURE = 1.0;${graph.inputs.has("pose") ? "\nconst float POSE = 0.0;          // of what moves: 0 at the first value of its range, 1 at the last" : ""}

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
