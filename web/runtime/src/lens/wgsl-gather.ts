/** WGSL that reads a frame and finds where to cut it into layers (`lightwell/lens/layers.py`, `thresholds`). */

import { CUT, FLAGS, FRAME } from "./wgsl-frame.ts";

/** Light and blur of every pixel, cleaned, and the histograms that the cut is found from. */
export const GATHER = /* wgsl */ `
${FRAME}${CUT}
@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var color: texture_2d<f32>;
@group(0) @binding(2) var depth: texture_2d<f32>;
@group(0) @binding(3) var motion: texture_2d<f32>;
@group(0) @binding(4) var<storage, read_write> light: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> place: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> stats: array<atomic<u32>>;

struct Pixel { light: vec4f, inverse: f32, motion: vec2f, good: bool }

// By its bits: compilers may take for granted that numbers are finite.
fn endless(v: f32) -> bool { return (bitcast<u32>(v) & 0x7f800000u) == 0x7f800000u; }

fn read(at: vec2i) -> Pixel {
  var p: Pixel;
  p.light = textureLoad(color, at, 0);
  let d = textureLoad(depth, at, 0).x;
  let v = frame.inverse;
  p.inverse = (v.x * d + v.y) / (v.z * d + v.w);
  if ((frame.flags & ${FLAGS.opaque}u) != 0u) { p.light.w = 1.0; }
  if ((frame.flags & ${FLAGS.motion}u) != 0u) { p.motion = textureLoad(motion, at, 0).xy; }
  let far = endless(d) && v.z != 0.0 && (bitcast<u32>(d) == 0x7f800000u);
  if (far) { p.inverse = v.x / v.z; }
  p.good = !(endless(p.light.x) || endless(p.light.y) || endless(p.light.z) || endless(p.light.w)
    || (endless(d) && !far) || endless(p.inverse) || p.inverse < 0.0 || endless(p.motion.x) || endless(p.motion.y));
  return p;
}

var<workgroup> bins: array<atomic<u32>, BINS>;
// Bad pixels, and those whose blur or motion was cut.
var<workgroup> counts: array<atomic<u32>, 2>;

@compute @workgroup_size(16, 16)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u, @builtin(local_invocation_index) i: u32) {
  for (var k = i; k < BINS; k += 256u) { atomicStore(&bins[k], 0u); }
  if (i < 2u) { atomicStore(&counts[i], 0u); }
  workgroupBarrier();
  for (var k = 0u; k < 16u; k++) {
    let at = vec2i(group.xy * 64u + local.xy + 16u * vec2u(k & 3u, k >> 2u));
    if (all(at < vec2i(frame.size))) { one(at); }
  }
  workgroupBarrier();
  for (var k = i; k < BINS; k += 256u) {
    let count = atomicLoad(&bins[k]);
    if (count > 0u) { atomicAdd(&stats[k], count); }
  }
  if (i < 2u) {
    let count = atomicLoad(&counts[i]);
    if (count > 0u) { atomicAdd(&stats[BAD_AT + i], count); }
  }
}

fn one(at: vec2i) {
  let last = vec2i(frame.size) - 1;
  var p = read(at);
  if (!p.good) {
    atomicAdd(&counts[0], 1u);
    p = neighbour(at, last);
  }
  let index = u32(at.y) * frame.size.x + u32(at.x);
  let wanted = frame.strength * (frame.focus - p.inverse);
  let s = clamp(wanted, -frame.largest, frame.largest);
  var m = p.motion * frame.motion;
  if (abs(wanted) > frame.largest || length(m) > frame.longest) { atomicAdd(&counts[1], 1u); }
  m *= min(1.0, frame.longest / max(length(m), 1e-9));
  light[index] = p.light;
  place[index] = vec4f(s, m, NOTHING);
  atomicAdd(&bins[u32(clamp((s / max(frame.largest, 1e-6) * 0.5 + 0.5) * f32(BINS), 0.0, f32(BINS - 1u)))], 1u);
  if (any(at == vec2i(0)) || any(at == last)) {
    let brightest = max(p.light.x, max(p.light.y, max(p.light.z, 1e-9)));
    atomicAdd(&stats[LEVELS_AT + u32(clamp((log2(brightest) + 16.0) * 4.0, 0.0, f32(LEVELS - 1u)))], 1u);
  }
}

/** The nearest good pixel within two; none of them: no light, and the hole is filled by normalisation. */
fn neighbour(at: vec2i, last: vec2i) -> Pixel {
  var best: Pixel;
  best.inverse = frame.focus;
  var nearest = 100;
  for (var y = -2; y <= 2; y++) {
    for (var x = -2; x <= 2; x++) {
      let far = x * x + y * y;
      let there = at + vec2i(x, y);
      if (far == 0 || far >= nearest || any(there < vec2i(0)) || any(there > last)) { continue; }
      let p = read(there);
      if (p.good) { best = p; nearest = far; }
    }
  }
  return best;
}
`;

const STATISTICS = /* wgsl */ `
${FRAME}${CUT}
@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read_write> stats: array<atomic<u32>>;
@group(0) @binding(2) var<storage, read_write> cuts: Cuts;
fn middle(bin: f32) -> f32 { return (bin / f32(BINS) * 2.0 - 1.0) * frame.largest; }
`;

/** The range of s that candidates lie in: percentiles 0.5 and 99.5; no cut is known yet. One workgroup. */
export const RANGE = /* wgsl */ `
${STATISTICS}
var<workgroup> sums: array<u32, 256>;
@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) i: u32) {
  const EACH = BINS / 256u;
  var sum = 0u;
  for (var k = 0u; k < EACH; k++) { sum += atomicLoad(&stats[i * EACH + k]); }
  sums[i] = sum;
  workgroupBarrier();
  if (i > 1u) { return; }
  let rank = select(0.005, 0.995, i == 1u) * f32(frame.size.x * frame.size.y - 1u);
  var below = 0u;
  var block = 0u;
  while (block < 255u && f32(below + sums[block]) <= rank) { below += sums[block]; block++; }
  var bin = block * EACH;
  while (bin < BINS - 1u && f32(below + atomicLoad(&stats[bin])) <= rank) { below += atomicLoad(&stats[bin]); bin++; }
  let value = middle(f32(bin) + 0.5);
  if (i == 0u) { cuts.low = value; cuts.count = 0u; } else { cuts.high = value; }
}
`;

/**
 * How many edges that no cut crosses yet cross each candidate: differences, that is +1 where an edge begins to count and -1
 * where it ends.
 */
export const EDGES = /* wgsl */ `
${STATISTICS}
@group(0) @binding(3) var<storage, read> place: array<vec4f>;
// Jumps between neighbours that count as an edge, px.
const JUMP = 2.0;
var<workgroup> counts: array<atomic<i32>, 65>;

fn edge(a: f32, b: f32) {
  if (abs(a - b) < JUMP) { return; }
  let step = (cuts.high - cuts.low) / f32(PLACES + 1u);
  if (!(step > 0.0)) { return; }
  for (var k = 0u; k < cuts.count; k++) { if (min(a, b) < cuts.at[k] && max(a, b) > cuts.at[k]) { return; } }
  // Candidate i lies at low + (i + 1) step; it counts strictly inside (min + SOFT/2, max - SOFT/2).
  let first = i32(clamp(floor((min(a, b) + 0.5 * SOFT - cuts.low) / step), 0.0, f32(PLACES)));
  let end = i32(clamp(ceil((max(a, b) - 0.5 * SOFT - cuts.low) / step) - 1.0, 0.0, f32(PLACES)));
  if (end > first) {
    atomicAdd(&counts[first], 1);
    atomicAdd(&counts[end], -1);
  }
}

@compute @workgroup_size(16, 16)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u, @builtin(local_invocation_index) i: u32) {
  if (i < 65u) { atomicStore(&counts[i], 0); }
  workgroupBarrier();
  for (var k = 0u; k < 16u; k++) {
    let at = group.xy * 64u + local.xy + 16u * vec2u(k & 3u, k >> 2u);
    if (any(at >= frame.size)) { continue; }
    let index = at.y * frame.size.x + at.x;
    if (at.x + 1u < frame.size.x) { edge(place[index].x, place[index + 1u].x); }
    if (at.y + 1u < frame.size.y) { edge(place[index].x, place[index + frame.size.x].x); }
  }
  workgroupBarrier();
  if (i < 65u) {
    let count = atomicLoad(&counts[i]);
    if (count != 0) { atomicAdd(&stats[EDGES_AT + i], bitcast<u32>(count)); }
  }
}
`;

/** One cut more: the best candidate, by edges that cross it less pixels of surfaces that it cuts through. */
export const CHOOSE = /* wgsl */ `
${STATISTICS}
// A pixel of a surface that is cut through weighs this much against an edge.
const THROUGH = 0.05;
var<workgroup> scores: array<f32, PLACES>;
fn insert(value: f32) {
  var k = cuts.count;
  while (k > 0u && cuts.at[k - 1u] > value) {
    cuts.at[k] = cuts.at[k - 1u];
    k--;
  }
  cuts.at[k] = value;
  cuts.count++;
}
@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) i: u32) {
  let step = (cuts.high - cuts.low) / f32(PLACES + 1u);
  let place = cuts.low + f32(i + 1u) * step;
  var crossed = 0;
  for (var k = 0u; k <= i; k++) { crossed += bitcast<i32>(atomicLoad(&stats[EDGES_AT + k])); }
  let scale = f32(BINS) * 0.5 / max(frame.largest, 1e-6);
  let first = u32(clamp((place - SOFT) * scale + 0.5 * f32(BINS), 0.0, f32(BINS)));
  let end = u32(clamp((place + SOFT) * scale + 0.5 * f32(BINS), 0.0, f32(BINS)));
  var through = 0u;
  for (var k = first; k < end; k++) { through += atomicLoad(&stats[k]); }
  scores[i] = f32(crossed) - THROUGH * f32(through);
  for (var k = 0u; k < cuts.count; k++) { if (abs(place - cuts.at[k]) <= 2.0 * SOFT) { scores[i] = 0.0; } }
  workgroupBarrier();
  storageBarrier();
  // The next cut counts its own edges.
  atomicStore(&stats[EDGES_AT + i], 0u);
  if (i == 0u) {
    atomicStore(&stats[EDGES_AT + PLACES], 0u);
    var best = 0u;
    for (var k = 1u; k < PLACES; k++) { if (scores[k] > scores[best]) { best = k; } }
    if ((frame.flags & ${FLAGS.autoCut}u) == 0u) {
      cuts.at[0] = frame.cut;
      cuts.count = 1u;
    } else if (scores[best] > 0.0) {
      insert(cuts.low + f32(best + 1u) * step);
    }
  }
}
`;

/** What light from outside the picture is held to: twice the border's median. */
export const BORDER = /* wgsl */ `
${STATISTICS}
@compute @workgroup_size(1)
fn main() {
  var total = 0u;
  for (var k = 0u; k < LEVELS; k++) { total += atomicLoad(&stats[LEVELS_AT + k]); }
  var below = 0u;
  var level = 0u;
  while (level < LEVELS - 1u && 2u * (below + atomicLoad(&stats[LEVELS_AT + level])) < total) {
    below += atomicLoad(&stats[LEVELS_AT + level]);
    level++;
  }
  cuts.border = max(frame.white, 2.0 * exp2((f32(level) + 0.5) / 4.0 - 16.0));
}
`;
