/** WGSL that puts the blurred layers together, front to back. */

import { SEEDS } from "./wgsl-fill.ts";
import { CUT, FLAGS, FRAME } from "./wgsl-frame.ts";

/** Formats that the picture may be written in. */
export type PictureFormat = "rgba16float" | "rgba32float" | "rgba8unorm";

/**
 * The front layer covers all where no pixel that is seen of the back layer lies within its blur: what lacks there is lost
 * between surfaces of the front layer whose kernels differ.
 */
const TWO = /* wgsl */ `
${CUT}${SEEDS}
@group(0) @binding(3) var<storage, read> image_behind: array<vec2i>;
@group(0) @binding(4) var<storage, read> cut: Cut;
@group(0) @binding(5) var<storage, read> place: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> seeds: array<vec2u>;
fn closed(layer: vec4f, at: vec2u) -> vec4f {
  let index = at.y * frame.size.x + at.x;
  let blur = abs(place[index].x) + 0.5 * length(place[index].yz);
  let inside = smoothstep(blur + 1.0, blur + 3.0, away(vec2i(at), seeds[index].x));
  return layer * mix(1.0, 1.0 / max(layer.w, 0.5), inside * cut.present);
}
`;

/** The last pass, for one layer or two. */
export const composite = (layers: 1 | 2, format: PictureFormat): string => /* wgsl */ `
${FRAME}
@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var picture: texture_storage_2d<${format}, write>;
@group(0) @binding(2) var<storage, read> image: array<vec2i>;
${layers === 2 ? TWO : ""}

fn plane() -> u32 { return 2u * frame.domain.x * frame.domain.y; }

/** Solved charges and pixels of a layer, within their bounds: light >= 0, coverage in [0, 1]. */
fn tidy(a: vec2i, b: vec2i, c: vec2i, d: vec2i) -> vec4f {
  let sum = vec4f(bitcast<vec2f>(a), bitcast<vec2f>(b)) + vec4f(vec2f(c), vec2f(d)) * exp2(-16.0);
  let layer = max(sum, vec4f(0.0));
  return layer / max(layer.w, 1.0);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
  if (any(id.xy >= frame.size)) { return; }
  let index = (id.y + u32(frame.guard)) * frame.domain.x + id.x + u32(frame.guard);
  let pair = frame.domain.x * frame.domain.y;
  var out = tidy(image[index], image[index + pair], image[index + plane()], image[index + plane() + pair]);
  ${
    layers === 2
      ? `let behind = tidy(image_behind[index], image_behind[index + pair], image_behind[index + plane()], image_behind[index + plane() + pair]);
  out = closed(out, id.xy);
  out += (1.0 - out.w) * behind;`
      : ""
  }
  if ((frame.flags & ${FLAGS.normalise}u) != 0u) {
    out = select(vec4f(0.0), vec4f(out.xyz / max(out.w, 1e-4), 1.0), out.w > 1e-4);
  }
  textureStore(picture, vec2i(id.xy), vec4f(out.xyz * frame.white, min(out.w, 1.0)));
}
`;
