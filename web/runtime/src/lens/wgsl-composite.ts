/** WGSL that puts the blurred layers together, back to front. */

import { SEEDS } from "./wgsl-fill.ts";
import { CUT, FLAGS, FRAME } from "./wgsl-frame.ts";

/** Formats that the picture may be written in. */
export type PictureFormat = "rgba16float" | "rgba32float" | "rgba8unorm";

const LAYER = /* wgsl */ `
/** The solved layer at a pixel within its bounds: light >= 0, coverage in [0, 1]. */
fn blurred(at: vec2u) -> vec4f {
  let index = (at.y + u32(frame.guard)) * frame.domain.x + at.x + u32(frame.guard);
  let pair = frame.domain.x * frame.domain.y;
  let charges = vec4f(bitcast<vec2f>(image[index]), bitcast<vec2f>(image[index + pair]));
  let pixels = vec4f(vec2f(image[index + 2u * pair]), vec2f(image[index + 3u * pair])) * exp2(-16.0);
  let layer = max(charges + pixels, vec4f(0.0));
  return layer / max(layer.w, 1.0);
}

/**
 * A layer covers all where no pixel that is seen of those behind it lies within its blur: what lacks there is lost between
 * surfaces of the layer whose kernels differ.
 */
fn closed(layer: vec4f, spot: vec4f, deeper: f32) -> vec4f {
  let blur = abs(spot.x) + 0.5 * length(spot.yz);
  return layer * mix(1.0, 1.0 / max(layer.w, 0.5), smoothstep(blur + 1.0, blur + 3.0, deeper));
}
`;

/** A layer behind others over those behind it; how far the nearest seen pixel of all of these is goes into `place`. */
export const accumulate = (layers: number): string => /* wgsl */ `
${FRAME}${CUT}${SEEDS}
@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> part: Part;
@group(0) @binding(2) var<storage, read> cuts: Cuts;
@group(0) @binding(3) var<storage, read> image: array<vec2i>;
@group(0) @binding(4) var<storage, read> filled_place: array<vec4f>;
@group(0) @binding(5) var<storage, read> seeds: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> place: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> behind: array<vec4f>;
${LAYER}
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
  if (any(id.xy >= frame.size)) { return; }
  let at = id.y * frame.size.x + id.x;
  var out = vec4f(0.0);
  if (part.number < ${layers - 1}u) { out = behind[at]; }
  if (part.number <= cuts.count) {
    var layer = blurred(id.xy);
    let deeper = place[at].w;
    if (part.number < cuts.count) { layer = closed(layer, filled_place[at], deeper); }
    out = layer + (1.0 - layer.w) * out;
    place[at].w = min(deeper, away(vec2i(id.xy), seeds[at].x));
  }
  behind[at] = out;
}
`;

const OVER = /* wgsl */ `
@group(0) @binding(3) var<storage, read> cuts: Cuts;
@group(0) @binding(4) var<storage, read> place: array<vec4f>;
@group(0) @binding(5) var<storage, read> behind: array<vec4f>;
`;

/** The last pass: the front layer over all others, as a picture. */
export const composite = (layers: number, format: PictureFormat): string => /* wgsl */ `
${FRAME}${CUT}
@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var picture: texture_storage_2d<${format}, write>;
@group(0) @binding(2) var<storage, read> image: array<vec2i>;
${layers > 1 ? OVER : ""}${LAYER}
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
  if (any(id.xy >= frame.size)) { return; }
  var out = blurred(id.xy);
  ${
    layers > 1
      ? `let at = id.y * frame.size.x + id.x;
  if (cuts.count > 0u) { out = closed(out, place[at], place[at].w); }
  out += (1.0 - out.w) * behind[at];`
      : ""
  }
  if ((frame.flags & ${FLAGS.normalise}u) != 0u) {
    out = select(vec4f(0.0), vec4f(out.xyz / max(out.w, 1e-4), 1.0), out.w > 1e-4);
  }
  textureStore(picture, vec2i(id.xy), vec4f(out.xyz * frame.white, min(out.w, 1.0)));
}
`;
