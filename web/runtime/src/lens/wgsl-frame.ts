/** WGSL that several passes share: what a frame is, and how a layer's share of a pixel is found. */

/** Depth layers that a frame may have. */
export const MOST_LAYERS = 4;

/** Bits of `flags`. */
export const FLAGS = { autoCut: 1, motion: 2, opaque: 4, normalise: 8 } as const;

/** Bytes of the uniform block below. */
export const FRAME_BYTES = 96;

export const FRAME = /* wgsl */ `
struct Frame {
  size: vec2u,       // of the picture, px
  domain: vec2u,     // of the charge image
  guard: i32,        // where the picture begins in it
  extend: i32,       // px around the picture that shine too
  seed: u32,         // 16 · frame number
  flags: u32,
  inverse: vec4f,    // 1/z = (x d + y) / (z d + w)
  strength: f32,     // Kc
  focus: f32,        // 1 / focus distance
  largest: f32,      // blur is cut here, px
  longest: f32,      // and motion here
  motion: vec2f,     // from the texture's unit to px over the open shutter
  white: f32,
  tolerance: f32,    // error in whites at which a pixel takes the finer tier
  cut: f32,          // between two layers, where cuts are not found by themselves
  pad0: f32, pad1: f32, pad2: f32,
}
`;

/** Layout of the statistics: histogram of s, differences of edges over candidates, histogram of the border, bad and cut pixels. */
export const STATS = { bins: 2048, places: 64, levels: 128 } as const;
export const STATS_WORDS = STATS.bins + (STATS.places + 1) + STATS.levels + 2;

export const CUT = /* wgsl */ `
const BINS = ${STATS.bins}u;
const PLACES = ${STATS.places}u;
const EDGES_AT = ${STATS.bins}u;
const LEVELS = ${STATS.levels}u;
const LEVELS_AT = ${STATS.bins + STATS.places + 1}u;
const BAD_AT = ${STATS.bins + STATS.places + 1 + STATS.levels}u;   // and after it those whose blur or motion was cut
// Width of the soft border between two layers, px of circle of confusion.
const SOFT = 1.5;
// How far away what is not there is, px.
const NOTHING = 1e9;

struct Cuts {
  at: vec4f,         // circles of confusion where layers part, ascending
  count: u32,        // so many of them are there, and one layer more
  low: f32,          // candidates lie in between
  high: f32,
  border: f32,       // light from outside the picture is held to this
}

/** Number of a layer, front to back. */
struct Part { number: u32, pad0: u32, pad1: u32, pad2: u32 }

/** Share of a surface with circle of confusion s that lies in front of a layer; 1 where the layer is not there. */
fn share_before(s: f32, number: u32, cuts: Cuts) -> f32 {
  if (number == 0u) { return 0.0; }
  if (number > cuts.count) { return 1.0; }
  return clamp((cuts.at[number - 1u] - s) / SOFT + 0.5, 0.0, 1.0);
}

/** Share of it that belongs to the layer. */
fn share_of(s: f32, number: u32, cuts: Cuts) -> f32 {
  return share_before(s, number + 1u, cuts) - share_before(s, number, cuts);
}
`;
