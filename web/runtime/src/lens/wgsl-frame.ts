/** WGSL that several passes share: what a frame is, and how a layer's share of a pixel is found. */

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
  cut: f32,          // between two layers, where it is not found by itself
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

struct Cut {
  at: f32,
  present: f32,
  low: f32,
  high: f32,
  border: f32,       // light from outside the picture is held to this
}

/** Share of a surface with circle of confusion s that belongs to the front layer. */
fn front_share(s: f32, cut: Cut) -> f32 {
  return select(0.0, clamp((cut.at - s) / SOFT + 0.5, 0.0, 1.0), cut.present > 0.0);
}
`;
