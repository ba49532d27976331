/**
 * WGSL that scatters: every pixel adds its light × the points of its spreadlet to integer images, by the integer mode of
 * `format/LENS.md`, whose sum over a pixel's charges is exactly zero.
 *
 * An image has two planes (charges, picture) of two pairs of channels: [plane][pair][row][column][2].
 */

import type { SpreadletLibrary } from "./library.ts";
import { turns } from "./library.ts";
import { CUT, FRAME } from "./wgsl-frame.ts";

/** Where a library lies in the shared buffers. */
export interface LibrarySlot {
  readonly library: SpreadletLibrary;
  /** First value of each axis, first record and first word of points. */
  readonly axes: readonly [number, number, number];
  readonly records: number;
  readonly words: number;
}

/** Motion shorter than this is none where a library without motion is at hand, px. */
const STILL = 0.25;

const CODE = { depth: 0, "depth-speed": 1, "shaped-speed": 2, "cats-eye": 3 } as const;

const POINT = {
  8: /* wgsl */ `{
    let p = points[words + k];
    return vec3i(i32(p << 24u) >> 24u, i32(p << 16u) >> 24u, i32(p) >> 16u);
  }`,
  16: /* wgsl */ `{
    let p = points[words + 2u * k];
    return vec3i(i32(p << 16u) >> 16u, i32(p) >> 16u, i32(points[words + 2u * k + 1u] << 16u) >> 16u);
  }`,
} as const;

const scatterer = (name: string, slot: LibrarySlot): string => {
  const { library } = slot;
  const [radius, second, angle] = library.axes.map((axis, i) => `${slot.axes[i]}u, ${axis.length}u`) as [string, string, string];
  const dithered = library.family !== "depth";
  const point = `point_${name}`;
  return /* wgsl */ `
fn ${point}(k: u32) -> vec3i {
  const words = ${slot.words}u;
  ${POINT[library.offsetBits]}
}
fn scatter_${name}(at: vec2i, shine: vec4f, spot: vec3f) {
  let aim = aim_of(${CODE[library.family]}u, at, spot);
  var node = locate(${radius}, abs(spot.x), at, 0u, ${dithered});
  node += ${library.axes[0].length}u * locate(${second}, aim.second, at, 1u, ${dithered});
  node += ${library.axes[0].length * library.axes[1].length}u * locate(${angle}, aim.angle, at, 2u, ${dithered});
  var one = records[${slot.records}u + 2u * node];
  let brightest = max(abs(shine.x), max(abs(shine.y), abs(shine.z))) / frame.white;
  if (brightest * bitcast<f32>(one.w) > frame.tolerance) {
    let fine = records[${slot.records}u + 2u * node + 1u];
    if (fine.y != 0u) { one = fine; }
  }
  let mantissa = mantissa_of(shine, bitcast<f32>(one.z));
  let b = vec4u(mantissa.b);
  let plane = (one.y >> 31u) * plane_size();
  let end = one.x + (one.y & 0x7fffffffu);
  var e = vec4i((1i << mantissa.b) >> 1u);
  ${turns(library.family) ? turnedLoop(point) : wholeLoop(point)}
}
`;
};

const wholeLoop = (point: string): string => /* wgsl */ `
  let sign = i32(aim.turn.x);
  let width = i32(frame.domain.x);
  let start = at + frame.guard;
  for (var k = one.x; k < end; k++) {
    let p = ${point}(k);
    let t = mantissa.m * p.z + e;
    let n = t >> b;
    e = t - (n << b);
    let x = start.x + sign * p.x;
    add(plane, u32((start.y + sign * p.y) * width + select(x, x - width, x >= width)), n);
  }
`;

const turnedLoop = (point: string): string => /* wgsl */ `
  let turn = vec2i(round(aim.turn * 16384.0));
  let width = frame.domain.x;
  let start = vec2i((at + frame.guard) * 16384 + 32);
  for (var k = one.x; k < end; k++) {
    let p = ${point}(k);
    let t = mantissa.m * p.z + e;
    let n = t >> b;
    e = t - (n << b);
    let x = start.x + turn.x * p.x - turn.y * p.y;
    let y = start.y + turn.y * p.x + turn.x * p.y;
    let row = u32(y >> 14u) * width;
    let left = wrapped(u32(x >> 14u));
    let beside = wrapped(left + 1u);
    let fx = (x >> 6u) & 255;
    let fy = (y >> 6u) & 255;
    let lower = share(n, fy);
    let upper = n - lower;
    var right = share(upper, fx);
    add(plane, row + left, upper - right);
    add(plane, row + beside, right);
    right = share(lower, fx);
    add(plane, row + width + left, lower - right);
    add(plane, row + width + beside, right);
  }
`;

/** The scatter of a layer, for pixels at rest and for those that move. */
export function splat(still: LibrarySlot | null, moving: LibrarySlot | null): string {
  const slots = [still && (["still", still] as const), moving && (["moving", moving] as const)].filter((s) => s !== null);
  return /* wgsl */ `
${FRAME}${CUT}
@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> part: Part;
@group(0) @binding(2) var<storage, read> cuts: Cuts;
@group(0) @binding(3) var<storage, read> light: array<vec4f>;
@group(0) @binding(4) var<storage, read> place: array<vec4f>;
@group(0) @binding(5) var<storage, read> axes: array<f32>;
@group(0) @binding(6) var<storage, read> records: array<vec4u>;   // first, count | picture << 31, scale, peak
@group(0) @binding(7) var<storage, read> points: array<u32>;
@group(0) @binding(8) var<storage, read_write> image: array<atomic<i32>>;

fn plane_size() -> u32 { return frame.domain.x * frame.domain.y * 4u; }

/** Columns past the right end come back at the left. */
fn wrapped(x: u32) -> u32 { return select(x, x - frame.domain.x, x >= frame.domain.x); }

fn add(plane: u32, pixel: u32, n: vec4i) {
  let at = plane + 2u * pixel;
  let pair = 2u * frame.domain.x * frame.domain.y;
  atomicAdd(&image[at], n.x);
  atomicAdd(&image[at + 1u], n.y);
  atomicAdd(&image[at + pair], n.z);
  atomicAdd(&image[at + pair + 1u], n.w);
}

// ------------------------------------------------------------------ which node

fn pcg(v: u32) -> u32 {
  let state = v * 747796405u + 2891336453u;
  let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
  return (word >> 22u) ^ word;
}

fn dither(at: vec2i, axis: u32) -> f32 {
  let along = select(select(3518319155u, 2447445413u, axis == 1u), 3242174889u, axis == 0u);
  let down = select(select(2882110345u, 1052792407u, axis == 1u), 2447445413u, axis == 0u);
  let value = bitcast<u32>(at.x) * along + bitcast<u32>(at.y) * down + pcg(3u * (frame.seed + part.number) + axis);
  return f32(value >> 8u) * exp2(-24.0);
}

/** The node of a value on an axis: the upper of its two where the fraction exceeds a dither, or a half. */
fn locate(start: u32, count: u32, value: f32, at: vec2i, axis: u32, dithered: bool) -> u32 {
  if (count < 2u) { return 0u; }
  var low = 0u;
  var high = count - 1u;
  while (high - low > 1u) {
    let middle = (low + high) / 2u;
    if (axes[start + middle] <= value) { low = middle; } else { high = middle; }
  }
  let a = axes[start + low];
  let fraction = clamp((value - a) / (axes[start + high] - a), 0.0, 1.0);
  return low + select(0u, 1u, fraction > select(0.5, dither(at, axis), dithered));
}

struct Aim { second: f32, angle: f32, turn: vec2f }

/** Second axis, baked angle and turn of a pixel: at rest mirrored in front of focus, else along motion or radius. */
fn aim_of(family: u32, at: vec2i, spot: vec3f) -> Aim {
  let sign = select(1.0, -1.0, spot.x < 0.0);
  let speed = length(spot.yz);
  var aim = Aim(0.0, 0.0, vec2f(sign, 0.0));
  if (family == 1u) {
    aim.second = speed;
    aim.turn = select(spot.yz / max(speed, 1e-9), vec2f(1.0, 0.0), speed < 1e-6);
  } else if (family == 2u) {
    aim.second = speed;
    let angle = atan2(spot.z, spot.y);
    aim.angle = select(angle, angle + 3.14159265, angle < 0.0);
  } else if (family == 3u) {
    let centre = 0.5 * (vec2f(frame.size) - 1.0);
    let from_centre = vec2f(at) - centre;
    let far = length(from_centre);
    aim.second = far / max(length(centre), 1e-9);
    aim.turn = sign * select(vec2f(1.0, 0.0), from_centre / max(far, 1e-9), far > 0.0);
  }
  return aim;
}

// ------------------------------------------------------------------ integers

struct Mantissa { m: vec4i, b: u32 }

/** Four 16-bit mantissas and their shift. Light beyond 16384 whites is cut. */
fn mantissa_of(shine: vec4f, scale: f32) -> Mantissa {
  let u = clamp(shine / frame.white, vec4f(-16384.0), vec4f(16384.0)) * (scale * 65536.0);
  let top = max(max(abs(u.x), abs(u.y)), max(abs(u.z), abs(u.w)));
  let exponent = select(0, i32((bitcast<u32>(top) >> 23u) & 255u) - 126, top > 0.0);
  let b = u32(clamp(15 - exponent, 0, 29));
  return Mantissa(clamp(vec4i(round(u * f32(1u << b))), vec4i(-32767), vec4i(32767)), b);
}

/** n · weight / 256, rounded, within 32 bits; what is left of n is the other share, so that nothing is lost. */
fn share(n: vec4i, weight: i32) -> vec4i {
  return (n >> vec4u(8u)) * weight + (((n & vec4i(255)) * weight + 128) >> vec4u(8u));
}

// ------------------------------------------------------------------ points
${slots.map(([name, slot]) => scatterer(name, slot)).join("")}
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
  let at = vec2i(id.xy) - frame.extend;
  let last = vec2i(frame.size) - 1;
  if (any(at > last + frame.extend)) { return; }
  let inside = clamp(at, vec2i(0), last);
  let index = u32(inside.y) * frame.size.x + u32(inside.x);
  let spot = place[index].xyz;
  // Layers behind the first hold their own share of light already.
  var shine = light[index] * select(1.0, share_of(spot.x, 0u, cuts), part.number == 0u);
  if (any(at != inside)) {
    // Light from outside the picture: its border repeated, as far as that reaches in, without its highlights.
    let away = max(abs(at.x - inside.x), abs(at.y - inside.y));
    if (f32(away) > abs(spot.x) + 0.5 * length(spot.yz) + 1.0) { return; }
    shine = vec4f(min(shine.xyz, vec3f(cuts.border)), shine.w);
  }
  if (all(shine == vec4f(0.0))) { return; }
  ${
    still && moving
      ? `if (length(spot.yz) < ${STILL}) { scatter_still(at, shine, spot); } else { scatter_moving(at, shine, spot); }`
      : `scatter_${slots[0]![0]}(at, shine, spot);`
  }
}
`;
}
