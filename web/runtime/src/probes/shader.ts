/** The query of a probe volume as shader text: one function (place, normal) → (irradiance, trusted share). */

import { momentsGlsl, ROW } from "./baselines.ts";
import type { ProbeFile } from "./file.ts";
import { BRICK_WORDS } from "./tables.ts";
import { overHat, RECORDS, rawGlsl, rawWgsl } from "./weights.ts";

/** Texels of a row of the texture of words, as a power of two. */
export const ROW_BITS = 11;
/** Trust below this is none (`probes/weights`). */
const THRESHOLD = 0.02;
const [FALLBACK, TAKES_OVER] = [1e-5, 0.05];
/** Texels of a brick. */
const BRICK = BRICK_WORDS / 4;

/** Names and numbers that both languages share. */
function numbers({ at, origin, spacing, shape, unit, function: kind }: ProbeFile) {
  const float = (value: number) => (Number.isInteger(value) ? `${value}.0` : `${value}`);
  return {
    at,
    unit: float(unit),
    origin: origin.map(float).join(", "),
    inverse: float(1 / spacing),
    cells: shape.map((n) => n - 1),
    shape,
    texels: RECORDS[kind]! / 4,
    threshold: float(THRESHOLD),
    scale: float(1 / (1 - THRESHOLD)),
    fallback: float(FALLBACK),
    over: float(1 / TAKES_OVER),
  };
}

/**
 * GLSL ES 3.0. Bind the words to `usampler2D NAME_words`; ask `vec4 NAME(vec3 place, vec3 normal)`. The int `NAME_mode` chooses
 * 0 learned weights, 1 trilinear ones of the probes in air, 2 of all, or 3 distance moments where the file holds them; `NAME_share` is then the share of probe `NAME_probe` in the answer.
 */
export function probesGlsl(file: ProbeFile, name: string): string {
  const n = numbers(file);
  return `
int ${name}_mode = 0, ${name}_probe = -1;
float ${name}_share = 0.0;
vec4 ${name}_low;
vec4 ${name}_high;
uvec4 ${name}_word(int i) { return texelFetch(${name}_words, ivec2(i & ${(1 << ROW_BITS) - 1}, i >> ${ROW_BITS}), 0); }
vec4 ${name}_signed(uint w) { return vec4((ivec4(int(w)) << ivec4(24, 16, 8, 0)) >> 24); }
${rawGlsl(file.function, name)}
float ${name}_rho(uvec4 node, vec3 u, float hat) {
  if (${name}_mode == 2) return 1.0;
  if (node.x < 2u) return float(node.x);
  if (${name}_mode == 1) return 1.0;
  ivec3 o = min(ivec3(2.0 * u + 2.0), ivec3(3));
  int bit = o.x + 4 * o.y + 16 * o.z;
  if ((((bit < 32 ? node.y : node.z) >> uint(bit & 31)) & 1u) == 0u) return 0.0;
  float raw = ${name}_raw(${n.at.weights} + (int(node.x) - 2) * ${n.texels}, u);
  return clamp((raw - ${n.threshold}) * ${n.scale}, 0.0, 1.0)${overHat(file.function, "hat")};
}
vec3 ${name}_light(int probe) {
  int row = ${n.at.traced > 0 ? `(${name}_mode == 0 ? ${n.at.light} : ${n.at.traced})` : n.at.light} + 2 * probe;
  uvec4 a = ${name}_word(row), b = ${name}_word(row + 1);
  vec2 rg = unpackHalf2x16(a.x), bs = unpackHalf2x16(a.y);
  vec3 rest = vec3(
    dot(${name}_signed(a.z), ${name}_low) + dot(${name}_signed(a.w), ${name}_high),
    dot(${name}_signed(b.x), ${name}_low) + dot(${name}_signed(b.y), ${name}_high),
    dot(${name}_signed(b.z), ${name}_low) + dot(${name}_signed(b.w), ${name}_high));
  return 0.28209479177387814 * vec3(rg, bs.x) + bs.y * rest;
}
// Bit k: corner k of a cell counts on this side of the cell's sheet, whose number counts from 1.
uint ${name}_counted(uint sheet, vec3 f) {
  if (sheet == 0u || ${name}_mode != 0) return 255u;
  uvec4 s = ${name}_word(${n.at.sheets} + int(sheet) - 1);
  vec2 xy = unpackHalf2x16(s.x), zd = unpackHalf2x16(s.y);
  return dot(vec3(xy, zd.x), f) + zd.y > 0.0 ? s.z >> 8u : s.z;
}
vec4 ${name}_add(int probe, float hat, vec3 u, bool counts, inout float inner) {
  if (hat <= 0.0) return vec4(0.0);
  ${n.at.moments > 0 ? `// Nodes behind a surface are ours alone.
  if (${name}_mode == 1 && ${name}_word(${n.at.moments} + probe * ${ROW}).w == 0u) return vec4(0.0);` : ""}
  uvec4 node = ${name}_word(${n.at.nodes} + probe);
  inner += hat * float(node.w);
  float phi = counts ? hat * ${name}_rho(node, u, hat) : 0.0;
  if (probe == ${name}_probe) ${name}_share += phi;
  return phi > 0.0 ? vec4(phi * ${name}_light(probe), phi) : vec4(0.0);
}
${n.at.moments > 0 ? momentsGlsl(file, name) : ""}
vec4 ${name}(vec3 place, vec3 n) {
  vec3 at = clamp((place - vec3(${n.origin})) * ${n.inverse}, vec3(0.0), vec3(${n.cells.join(", ")}));
  ivec3 cell = min(ivec3(at), ivec3(${n.cells.map((c) => c - 1).join(", ")}));
  vec3 f = at - vec3(cell);
  ${name}_low = vec4(-0.4886025119029199 * n.y, 0.4886025119029199 * n.z, -0.4886025119029199 * n.x, 1.0925484305920792 * n.x * n.y);
  ${name}_high = vec4(-1.0925484305920792 * n.y * n.z, 0.31539156525252005 * (3.0 * n.z * n.z - 1.0), -1.0925484305920792 * n.x * n.z,
    0.5462742152960396 * (n.x * n.x - n.y * n.y));
  ${name}_share = 0.0;
  vec4 total = vec4(0.0);
  float inner = 0.0;
  int number = (cell.z * ${n.cells[1]} + cell.y) * ${n.cells[0]} + cell.x;
  uvec4 more = ${name}_word(${n.at.cells} + 3 * number + 2);
  uint counted = ${name}_counted(more.y, f);
  ${n.at.moments > 0 ? `if (${name}_mode == 3) total = ${name}_moments(place, n, cell, f);
  else ` : ""}for (int k = 0; k < 8; k++) {
    ivec3 c = ivec3(k & 1, (k >> 1) & 1, k >> 2);
    vec3 u = f - vec3(c), h = 1.0 - abs(u);
    ivec3 p = cell + c;
    total += ${name}_add((p.z * ${n.shape[1]} + p.y) * ${n.shape[0]} + p.x, h.x * h.y * h.z, u, ((counted >> uint(k)) & 1u) > 0u, inner);
  }
  uint brick = more.x;
  if (brick > 0u && ${name}_mode == 0) {
    float before = ${name}_share;
    ${name}_share = 0.0;
    vec3 g = 3.0 * f;
    ivec3 low = min(ivec3(g), ivec3(2));
    g -= vec3(low);
    vec4 fine = vec4(0.0);
    inner = 0.0;
    int first = ${n.at.bricks} + (int(brick) - 1) * ${BRICK}, part = (low.z * 3 + low.y) * 3 + low.x;
    counted = ${name}_counted(${name}_word(first + 16 + (part >> 2))[part & 3], g);
    for (int k = 0; k < 8; k++) {
      ivec3 c = ivec3(k & 1, (k >> 1) & 1, k >> 2), p = low + c;
      vec3 u = g - vec3(c), h = 1.0 - abs(u);
      int row = (p.z * 4 + p.y) * 4 + p.x;
      uint probe = ${name}_word(first + (row >> 2))[row & 3];
      fine += ${name}_add(int(probe), h.x * h.y * h.z, u, ((counted >> uint(k)) & 1u) > 0u, inner);
    }
    float m = inner * smoothstep(0.0, 1.0, fine.w * ${n.over});
    total = mix(total, fine, m);
    ${name}_share = mix(before, ${name}_share, m);
  }
  float delta = ${name}_mode == 0 ? ${n.fallback} * max(1.0 - total.w, 0.0) : 1e-9;
  int octant = (f.x >= 0.5 ? 1 : 0) + (f.y >= 0.5 ? 2 : 0) + (f.z >= 0.5 ? 4 : 0);
  uint back = ${name}_word(${n.at.cells} + 3 * number + (octant >> 2))[octant & 3];
  vec3 e = total.rgb;
  if (back > 0u && delta > 0.0) e += delta * ${name}_light(int(back) - 1);
  ${name}_share /= max(total.w + delta, 1e-12);
  return vec4(max(e, 0.0) * (${n.unit} / max(total.w + delta, 1e-12)), total.w);
}
`;
}

/** WGSL. Bind the words to `NAME_words: texture_2d<u32>`; ask `fn NAME(place: vec3f, normal: vec3f) -> vec4f`. */
export function probesWgsl(file: ProbeFile, name: string): string {
  const n = numbers(file);
  return `
fn ${name}_word(i: i32) -> vec4u { return textureLoad(${name}_words, vec2i(i & ${(1 << ROW_BITS) - 1}, i >> ${ROW_BITS}), 0); }
fn ${name}_signed(w: u32) -> vec4f { return vec4f((vec4i(i32(w)) << vec4u(24u, 16u, 8u, 0u)) >> vec4u(24u)); }
${rawWgsl(file.function, name)}
fn ${name}_rho(node: vec4u, u: vec3f, hat: f32) -> f32 {
  if (node.x < 2u) { return f32(node.x); }
  let o = min(vec3i(2.0 * u + 2.0), vec3i(3));
  let bit = o.x + 4 * o.y + 16 * o.z;
  if (((select(node.z, node.y, bit < 32) >> u32(bit & 31)) & 1u) == 0u) { return 0.0; }
  let raw = ${name}_raw(${n.at.weights} + (i32(node.x) - 2) * ${n.texels}, u);
  return clamp((raw - ${n.threshold}) * ${n.scale}, 0.0, 1.0)${overHat(file.function, "hat")};
}
fn ${name}_light(probe: i32, low: vec4f, high: vec4f) -> vec3f {
  let a = ${name}_word(${n.at.light} + 2 * probe);
  let b = ${name}_word(${n.at.light} + 2 * probe + 1);
  let rg = unpack2x16float(a.x);
  let bs = unpack2x16float(a.y);
  let rest = vec3f(
    dot(${name}_signed(a.z), low) + dot(${name}_signed(a.w), high),
    dot(${name}_signed(b.x), low) + dot(${name}_signed(b.y), high),
    dot(${name}_signed(b.z), low) + dot(${name}_signed(b.w), high));
  return 0.28209479177387814 * vec3f(rg, bs.x) + bs.y * rest;
}
fn ${name}_counted(sheet: u32, f: vec3f) -> u32 {
  if (sheet == 0u) { return 255u; }
  let s = ${name}_word(${n.at.sheets} + i32(sheet) - 1);
  let xy = unpack2x16float(s.x);
  let zd = unpack2x16float(s.y);
  return select(s.z, s.z >> 8u, dot(vec3f(xy, zd.x), f) + zd.y > 0.0);
}
fn ${name}_add(probe: i32, hat: f32, u: vec3f, counts: bool, inner: ptr<function, f32>, low: vec4f, high: vec4f) -> vec4f {
  if (hat <= 0.0) { return vec4f(0.0); }
  let node = ${name}_word(${n.at.nodes} + probe);
  *inner += hat * f32(node.w);
  if (!counts) { return vec4f(0.0); }
  let phi = hat * ${name}_rho(node, u, hat);
  if (phi <= 0.0) { return vec4f(0.0); }
  return vec4f(phi * ${name}_light(probe, low, high), phi);
}
fn ${name}(place: vec3f, n: vec3f) -> vec4f {
  let at = clamp((place - vec3f(${n.origin})) * ${n.inverse}, vec3f(0.0), vec3f(${n.cells.join(", ")}));
  let cell = min(vec3i(at), vec3i(${n.cells.map((c) => c - 1).join(", ")}));
  let f = at - vec3f(cell);
  let low = vec4f(-0.4886025119029199 * n.y, 0.4886025119029199 * n.z, -0.4886025119029199 * n.x, 1.0925484305920792 * n.x * n.y);
  let high = vec4f(-1.0925484305920792 * n.y * n.z, 0.31539156525252005 * (3.0 * n.z * n.z - 1.0), -1.0925484305920792 * n.x * n.z,
    0.5462742152960396 * (n.x * n.x - n.y * n.y));
  var total = vec4f(0.0);
  var inner = 0.0;
  let number = (cell.z * ${n.cells[1]} + cell.y) * ${n.cells[0]} + cell.x;
  let more = ${name}_word(${n.at.cells} + 3 * number + 2);
  var counted = ${name}_counted(more.y, f);
  for (var k = 0; k < 8; k++) {
    let c = vec3i(k & 1, (k >> 1u) & 1, k >> 2u);
    let u = f - vec3f(c);
    let h = vec3f(1.0) - abs(u);
    let p = cell + c;
    total += ${name}_add((p.z * ${n.shape[1]} + p.y) * ${n.shape[0]} + p.x, h.x * h.y * h.z, u, ((counted >> u32(k)) & 1u) > 0u, &inner, low, high);
  }
  let brick = more.x;
  if (brick > 0u) {
    let s = min(vec3i(3.0 * f), vec3i(2));
    let g = 3.0 * f - vec3f(s);
    var fine = vec4f(0.0);
    inner = 0.0;
    let first = ${n.at.bricks} + (i32(brick) - 1) * ${BRICK};
    let part = (s.z * 3 + s.y) * 3 + s.x;
    counted = ${name}_counted(${name}_word(first + 16 + (part >> 2u))[part & 3], g);
    for (var k = 0; k < 8; k++) {
      let c = vec3i(k & 1, (k >> 1u) & 1, k >> 2u);
      let p = s + c;
      let u = g - vec3f(c);
      let h = vec3f(1.0) - abs(u);
      let row = (p.z * 4 + p.y) * 4 + p.x;
      let probe = ${name}_word(first + (row >> 2u))[row & 3];
      fine += ${name}_add(i32(probe), h.x * h.y * h.z, u, ((counted >> u32(k)) & 1u) > 0u, &inner, low, high);
    }
    total = mix(total, fine, inner * smoothstep(0.0, 1.0, fine.w * ${n.over}));
  }
  let delta = ${n.fallback} * max(1.0 - total.w, 0.0);
  let octant = select(0, 1, f.x >= 0.5) + select(0, 2, f.y >= 0.5) + select(0, 4, f.z >= 0.5);
  let back = ${name}_word(${n.at.cells} + 3 * number + (octant >> 2u))[octant & 3];
  var e = total.rgb;
  if (back > 0u && delta > 0.0) { e += delta * ${name}_light(i32(back) - 1, low, high); }
  return vec4f(max(e, vec3f(0.0)) * (${n.unit} / max(total.w + delta, 1e-12)), total.w);
}
`;
}
