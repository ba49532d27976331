/** Weight functions as shader text: record and probe-local place → value before clip and threshold (`format/PROBES.md`). */

/** Words of a record in files. */
export const RECORDS: Readonly<Record<string, number>> = {
  "relu-field": 16,
  "relu-field-5": 32,
  "product-field": 36,
  mlp: 32,
  "bare-relu-field-5": 32,
  "bare-product-field": 36,
  "bare-mlp": 32,
};

const [LOW, HIGH, SMOOTH_LOW, SMOOTH_HIGH, SLOPE] = [-8, 9, -4, 8, 0.01];
const STEP = (HIGH - LOW) / 255;
const SMOOTH_STEP = (SMOOTH_HIGH - SMOOTH_LOW) / 255;
/** The largest value that a smooth grid stores gives exactly 1. */
const FULL = 1 + Math.exp(-SMOOTH_HIGH);

/** The hat that a published form is divided by is at least this. */
const EDGE = 1e-3;

export const isBare = (name: string): boolean => name.startsWith("bare-");
const core = (name: string): string => name.replace("bare-", "");

/** `float NAME_raw(int first, vec3 u)`: `first` is the record's texel. */
export function rawGlsl(kind: string, name: string): string {
  const word = `${name}_word`;
  if (core(kind) === "relu-field")
    return `float ${name}_raw(int first, vec3 u) {
  vec3 at = (u + 1.0) * 1.5;
  ivec3 low = min(ivec3(at), ivec3(2));
  vec3 f = at - vec3(low);
  uvec4 a = ${word}(first + low.z), b = ${word}(first + low.z + 1);
  uvec4 rows = uvec4(a[low.y], a[low.y + 1], b[low.y], b[low.y + 1]) >> uint(8 * low.x);
  vec4 v = mix(vec4(rows & 255u), vec4((rows >> 8u) & 255u), f.x);
  vec2 w = mix(v.xz, v.yw, f.y);
  return mix(w.x, w.y, f.z) * ${STEP} + float(${LOW});
}`;
  if (core(kind) === "mlp")
    return `vec4 ${name}_leaky(vec4 v) { return max(v, ${SLOPE} * v); }
vec4 ${name}_four(uvec4 w, vec4 v) {
  return vec4(dot(${name}_signed(w.x), v), dot(${name}_signed(w.y), v), dot(${name}_signed(w.z), v), dot(${name}_signed(w.w), v));
}
vec4 ${name}_rows(uvec4 a, uvec4 b, vec4 g, vec4 h) {
  return ${name}_four(uvec4(a.xz, b.xz), g) + ${name}_four(uvec4(a.yw, b.yw), h);
}
float ${name}_raw(int first, vec3 u) {
  uvec4 last = ${word}(first + 7), d = ${word}(first + 6);
  vec3 steps = uintBitsToFloat(last.yzw);
  vec4 v = vec4(u, 1.0);
  vec4 g = ${name}_leaky(steps.x * ${name}_four(${word}(first), v)), h = ${name}_leaky(steps.x * ${name}_four(${word}(first + 1), v));
  vec4 p = ${name}_rows(${word}(first + 2), ${word}(first + 3), g, h) + ${name}_signed(d.x);
  vec4 q = ${name}_rows(${word}(first + 4), ${word}(first + 5), g, h) + ${name}_signed(d.y);
  p = ${name}_leaky(steps.y * p);
  q = ${name}_leaky(steps.y * q);
  return steps.z * (dot(${name}_signed(d.z), p) + dot(${name}_signed(d.w), q) + ${name}_signed(last.x).x);
}`;
  return `float ${name}_grid(int first, int start, int side, vec3 u) {
  vec3 at = (u + 1.0) * (0.5 * float(side - 1));
  ivec3 low = min(ivec3(at), ivec3(side - 2));
  vec3 f = at - vec3(low);
  float value = 0.0;
  for (int k = 0; k < 8; k++) {
    ivec3 c = ivec3(k & 1, (k >> 1) & 1, k >> 2), p = low + c;
    vec3 w = mix(1.0 - f, f, vec3(c));
    int i = start + (p.z * side + p.y) * side + p.x;
    uint word = ${word}(first + (i >> 4))[(i >> 2) & 3];
    value += w.x * w.y * w.z * float((word >> uint(8 * (i & 3))) & 255u);
  }
  return value;
}
float ${name}_raw(int first, vec3 u) {
  float sharp = ${name}_grid(first, 0, 5, u) * ${STEP} + float(${LOW});
  ${core(kind) === "product-field" ? `float smooth_ = ${name}_grid(first, 125, 2, u) * ${SMOOTH_STEP} + float(${SMOOTH_LOW});
  return clamp(sharp, 0.0, 1.0) * ${FULL} / (1.0 + exp(-smooth_));` : "return sharp;"}
}`;
}

/** The same as `fn NAME_raw(first: i32, u: vec3f) -> f32`. */
export function rawWgsl(kind: string, name: string): string {
  const word = `${name}_word`;
  if (core(kind) === "relu-field")
    return `fn ${name}_raw(first: i32, u: vec3f) -> f32 {
  let at = (u + 1.0) * 1.5;
  let low = min(vec3i(at), vec3i(2));
  let f = at - vec3f(low);
  let a = ${word}(first + low.z);
  let b = ${word}(first + low.z + 1);
  let rows = vec4u(a[low.y], a[low.y + 1], b[low.y], b[low.y + 1]) >> vec4u(u32(8 * low.x));
  let v = mix(vec4f(rows & vec4u(255u)), vec4f((rows >> vec4u(8u)) & vec4u(255u)), f.x);
  let w = mix(v.xz, v.yw, f.y);
  return mix(w.x, w.y, f.z) * ${STEP} + f32(${LOW});
}`;
  if (core(kind) === "mlp")
    return `fn ${name}_leaky(v: vec4f) -> vec4f { return max(v, ${SLOPE} * v); }
fn ${name}_four(w: vec4u, v: vec4f) -> vec4f {
  return vec4f(dot(${name}_signed(w.x), v), dot(${name}_signed(w.y), v), dot(${name}_signed(w.z), v), dot(${name}_signed(w.w), v));
}
fn ${name}_rows(a: vec4u, b: vec4u, g: vec4f, h: vec4f) -> vec4f {
  return ${name}_four(vec4u(a.xz, b.xz), g) + ${name}_four(vec4u(a.yw, b.yw), h);
}
fn ${name}_raw(first: i32, u: vec3f) -> f32 {
  let last = ${word}(first + 7);
  let d = ${word}(first + 6);
  let steps = bitcast<vec3f>(last.yzw);
  let v = vec4f(u, 1.0);
  let g = ${name}_leaky(steps.x * ${name}_four(${word}(first), v));
  let h = ${name}_leaky(steps.x * ${name}_four(${word}(first + 1), v));
  let p = ${name}_leaky(steps.y * (${name}_rows(${word}(first + 2), ${word}(first + 3), g, h) + ${name}_signed(d.x)));
  let q = ${name}_leaky(steps.y * (${name}_rows(${word}(first + 4), ${word}(first + 5), g, h) + ${name}_signed(d.y)));
  return steps.z * (dot(${name}_signed(d.z), p) + dot(${name}_signed(d.w), q) + ${name}_signed(last.x).x);
}`;
  return `fn ${name}_grid(first: i32, start: i32, side: i32, u: vec3f) -> f32 {
  let at = (u + 1.0) * (0.5 * f32(side - 1));
  let low = min(vec3i(at), vec3i(side - 2));
  let f = at - vec3f(low);
  var value = 0.0;
  for (var k = 0; k < 8; k++) {
    let c = vec3i(k & 1, (k >> 1u) & 1, k >> 2u);
    let p = low + c;
    let w = mix(1.0 - f, f, vec3f(c));
    let i = start + (p.z * side + p.y) * side + p.x;
    let word = ${word}(first + (i >> 4u))[(i >> 2u) & 3];
    value += w.x * w.y * w.z * f32((word >> u32(8 * (i & 3))) & 255u);
  }
  return value;
}
fn ${name}_raw(first: i32, u: vec3f) -> f32 {
  let sharp = ${name}_grid(first, 0, 5, u) * ${STEP} + f32(${LOW});
  ${core(kind) === "product-field" ? `let smooth_ = ${name}_grid(first, 125, 2, u) * ${SMOOTH_STEP} + f32(${SMOOTH_LOW});
  return clamp(sharp, 0.0, 1.0) * ${FULL} / (1.0 + exp(-smooth_));` : "return sharp;"}
}`;
}

/** What ρ is divided by: a published form answers the whole weight. */
export const overHat = (kind: string, hat: string): string => (isBare(kind) ? ` / max(${hat}, ${EDGE})` : "");
