/**
 * WGSL that continues a layer behind those in front of it (`lightwell/lens/layers.py`): the nearest pixel that is seen of
 * the layer, found by jump flooding (Rong and Tan 2006), gives way to a smooth membrane through all of them farther in, by a
 * convolution pyramid (`lightwell/lens/pyramid.py`, `fill`). Every level is padded with zeros by `PAD` on all sides.
 */

import { CUT, FRAME } from "./wgsl-frame.ts";

/** Zeros around every level. */
export const PAD = 5;

/** Size of the next level. */
export const coarser = (n: number): number => Math.ceil((n + 2 * PAD) / 2);

const KERNELS = /* wgsl */ `
const PAD = ${PAD};
const H1 = array<f32, 5>(0.1507, 0.6836, 1.0334, 0.6836, 0.1507);
const SYNTHESIS = 0.16432;
const G = array<f32, 3>(0.0312, 0.7753, 0.0312);
`;

const LEVEL = /* wgsl */ `
struct Level { fine: vec4u, coarse: vec4u }   // width, height, first texel, whether it is the coarsest
`;

/** What is known of the layer at a pixel of the picture: light and (s, motion, 1). */
const KNOWN = /* wgsl */ `
struct Pair { a: vec4f, b: vec4f }
fn known(at: vec2i) -> Pair {
  var p: Pair;
  if (any(at < vec2i(0)) || any(at >= vec2i(frame.size))) { return p; }
  let index = u32(at.y) * frame.size.x + u32(at.x);
  let spot = place[index];
  if (share_of(spot.x, part.number, cuts) > 0.5) {
    p.a = light[index];
    p.b = vec4f(spot.xyz, 1.0);
  }
  return p;
}
`;

const COARSEN = /* wgsl */ `
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
  if (any(id.xy >= level.coarse.xy) || part.number > cuts.count) { return; }
  var a = vec4f(0.0);
  var b = vec4f(0.0);
  for (var y = 0; y < 5; y++) {
    for (var x = 0; x < 5; x++) {
      let p = known(vec2i(id.xy) * 2 + vec2i(x, y) - 2 - PAD);
      let w = H1[x] * H1[y];
      a += w * p.a;
      b += w * p.b;
    }
  }
  let index = level.coarse.z + id.y * level.coarse.x + id.x;
  coarse_a[index] = a;
  coarse_b[index] = b;
}
`;

/** From the picture to the first level. */
export const COARSEN_FIRST = /* wgsl */ `
${FRAME}${CUT}${LEVEL}${KERNELS}
@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> level: Level;
@group(0) @binding(2) var<uniform> part: Part;
@group(0) @binding(3) var<storage, read> cuts: Cuts;
@group(0) @binding(4) var<storage, read> light: array<vec4f>;
@group(0) @binding(5) var<storage, read> place: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> coarse_a: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> coarse_b: array<vec4f>;
${KNOWN}${COARSEN}
`;

const STORED = /* wgsl */ `
struct Pair { a: vec4f, b: vec4f }
fn known(at: vec2i) -> Pair {
  var p: Pair;
  if (any(at < vec2i(0)) || any(at >= vec2i(level.fine.xy))) { return p; }
  let index = level.fine.z + u32(at.y) * level.fine.x + u32(at.x);
  p.a = coarse_a[index];
  p.b = coarse_b[index];
  return p;
}
`;

/** From one level to the next. */
export const COARSEN_NEXT = /* wgsl */ `
${CUT}${LEVEL}${KERNELS}
@group(0) @binding(0) var<uniform> level: Level;
@group(0) @binding(1) var<uniform> part: Part;
@group(0) @binding(2) var<storage, read> cuts: Cuts;
@group(0) @binding(3) var<storage, read_write> coarse_a: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> coarse_b: array<vec4f>;
${STORED}${COARSEN}
`;

/** The filtered level plus the upsampled coarser result. */
const REFINED = /* wgsl */ `
fn refined(at: vec2i) -> Pair {
  var p: Pair;
  for (var y = -1; y <= 1; y++) {
    for (var x = -1; x <= 1; x++) {
      let q = known(at + vec2i(x, y));
      let w = G[x + 1] * G[y + 1];
      p.a += w * q.a;
      p.b += w * q.b;
    }
  }
  if (level.coarse.w != 0u) { return p; }
  // Zeros lie between the coarser texels: only even padded places count.
  let padded = at + PAD;
  for (var y = -2; y <= 2; y++) {
    for (var x = -2; x <= 2; x++) {
      let j = padded + vec2i(x, y);
      if (((j.x | j.y) & 1) != 0 || any(j / 2 >= vec2i(level.coarse.xy))) { continue; }
      let index = level.coarse.z + u32(j.y / 2) * level.coarse.x + u32(j.x / 2);
      let w = SYNTHESIS * H1[x + 2] * SYNTHESIS * H1[y + 2];
      p.a += w * result_a[index];
      p.b += w * result_b[index];
    }
  }
  return p;
}
`;

/** From a level and the coarser result to its result. */
export const REFINE = /* wgsl */ `
${CUT}${LEVEL}${KERNELS}
@group(0) @binding(0) var<uniform> level: Level;
@group(0) @binding(1) var<uniform> part: Part;
@group(0) @binding(2) var<storage, read> cuts: Cuts;
@group(0) @binding(3) var<storage, read_write> coarse_a: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> coarse_b: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> result_a: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> result_b: array<vec4f>;
${STORED}${REFINED}
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
  if (any(id.xy >= level.fine.xy) || part.number > cuts.count) { return; }
  let p = refined(vec2i(id.xy));
  let index = level.fine.z + id.y * level.fine.x + id.x;
  result_a[index] = p.a;
  result_b[index] = p.b;
}
`;

/** Who is nearest of what is seen of the layer, and of what is well inside it: x | y << 16. */
export const SEEDS = /* wgsl */ `
// Nobody is known yet.
const NOBODY = 0xffffffffu;
fn away(at: vec2i, seed: u32) -> f32 {
  return select(length(vec2f(vec2i(i32(seed & 0xffffu), i32(seed >> 16u)) - at)), NOTHING, seed == NOBODY);
}
`;

/** Every seen pixel knows itself, and so does every one that has none but seen neighbours. */
export const SEED = /* wgsl */ `
${FRAME}${CUT}${SEEDS}
@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> part: Part;
@group(0) @binding(2) var<storage, read> cuts: Cuts;
@group(0) @binding(3) var<storage, read> place: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> seeds: array<vec2u>;
fn seen(at: vec2i) -> bool {
  if (any(at < vec2i(0)) || any(at >= vec2i(frame.size))) { return true; }
  return share_of(place[u32(at.y) * frame.size.x + u32(at.x)].x, part.number, cuts) > 0.5;
}
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
  if (any(id.xy >= frame.size) || part.number > cuts.count) { return; }
  var inner = true;
  for (var k = 0; k < 9; k++) { inner = inner && seen(vec2i(id.xy) + vec2i(k % 3, k / 3) - 1); }
  let me = id.x | (id.y << 16u);
  seeds[id.y * frame.size.x + id.x] = vec2u(select(NOBODY, me, seen(vec2i(id.xy))), select(NOBODY, me, inner));
}
`;

/** Every pixel takes the nearest of what its eight neighbours at a distance know. */
export const FLOOD = /* wgsl */ `
${FRAME}${CUT}${SEEDS}
struct Jump { step: i32, pad0: i32, pad1: i32, pad2: i32 }
@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> jump: Jump;
@group(0) @binding(2) var<uniform> part: Part;
@group(0) @binding(3) var<storage, read> cuts: Cuts;
@group(0) @binding(4) var<storage, read_write> seeds: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> next: array<vec2u>;
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
  if (any(id.xy >= frame.size) || part.number > cuts.count) { return; }
  let at = vec2i(id.xy);
  let index = id.y * frame.size.x + id.x;
  var best = seeds[index];
  var nearest = vec2f(away(at, best.x), away(at, best.y));
  for (var k = 0; k < 9; k++) {
    let there = at + (vec2i(k % 3, k / 3) - 1) * jump.step;
    if (any(there < vec2i(0)) || any(there >= vec2i(frame.size))) { continue; }
    let known = seeds[u32(there.y) * frame.size.x + u32(there.x)];
    let far = vec2f(away(at, known.x), away(at, known.y));
    best = select(best, known, far < nearest);
    nearest = min(nearest, far);
  }
  next[index] = best;
}
`;

/** A layer behind others: what is seen of it, and behind those its continuation. */
export const BEHIND = /* wgsl */ `
${FRAME}${CUT}${LEVEL}${KERNELS}${SEEDS}
@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> level: Level;
@group(0) @binding(2) var<uniform> part: Part;
@group(0) @binding(3) var<storage, read> cuts: Cuts;
@group(0) @binding(4) var<storage, read> light: array<vec4f>;
@group(0) @binding(5) var<storage, read> place: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> result_a: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> result_b: array<vec4f>;
@group(0) @binding(8) var<storage, read_write> seeds: array<vec2u>;
@group(0) @binding(9) var<storage, read_write> filled_light: array<vec4f>;
@group(0) @binding(10) var<storage, read_write> filled_place: array<vec4f>;
${KNOWN}${REFINED}
// Distance over which what lies nearest gives way to the membrane, px.
const FADE = 40.0;
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
  if (any(id.xy >= frame.size)) { return; }
  let at = vec2i(id.xy);
  let index = id.y * frame.size.x + id.x;
  var spot = place[index];
  let hidden = share_before(spot.x, part.number, cuts);
  let share = share_of(spot.x, part.number, cuts);
  // What is seen for the better part continues itself.
  var shine = light[index] * select(share, share + hidden, share > 0.5);
  if (hidden > 0.0 && share <= 0.5 && part.number <= cuts.count) {
    let seed = seeds[index];
    let far = away(at, seed.x);
    // Nobody sees what lies farther under its cover than blur and motion reach; what a deeper layer is nearer to is of that.
    if (far <= min(frame.largest + 0.5 * frame.longest + 2.0, spot.w)) {
      // A pixel on the border may hold light of what covers the rest: its inner neighbour is better.
      let from_there = select(seed.x, seed.y, away(at, seed.y) <= far + 1.1);
      let nearest = (from_there >> 16u) * frame.size.x + (from_there & 0xffffu);
      let own = exp(-(far / FADE) * (far / FADE));
      let p = refined(at);
      let weight = select(0.0, (1.0 - own) / p.b.w, p.b.w > 1e-20);
      let rest = select(1.0, own, p.b.w > 1e-20);
      shine += hidden * max(light[nearest] * rest + p.a * weight, vec4f(0.0));
      // Where a surface lies partly in front, the part behind is as far away as the layer, not as the surface.
      if (share < 0.5) { spot = vec4f(place[nearest].xyz * rest + p.b.xyz * weight, 0.0); }
    }
  }
  filled_light[index] = shine;
  filled_place[index] = spot;
}
`;
