/** The baseline of distance moments in GLSL (Majercik et al., JCGT 2019 and 2021; own code), for files that hold it. */

import type { ProbeFile } from "./file.ts";

const SIDE = 16;
/** Texels of a row: where the probe looks from, then 16² texels of an octahedral map, two half floats each. */
export const ROW = 1 + (SIDE * SIDE) / 4;

/** `vec4 NAME_moments(vec3 place, vec3 n, ivec3 cell, vec3 f)`: sum of weighted irradiance, and of weights. */
export function momentsGlsl(file: ProbeFile, name: string): string {
  const [nx, ny] = file.shape;
  const first = file.at.moments;
  return `
vec2 ${name}_texel(int probe, ivec2 p) {
  // Beyond an edge, the other coordinate is mirrored.
  if (p.x < 0 || p.x >= ${SIDE}) p.y = ${SIDE - 1} - p.y;
  if (p.y < 0 || p.y >= ${SIDE}) p.x = ${SIDE - 1} - p.x;
  p = clamp(p, ivec2(0), ivec2(${SIDE - 1}));
  int i = p.y * ${SIDE} + p.x;
  return unpackHalf2x16(${name}_word(${first} + probe * ${ROW} + 1 + (i >> 2))[i & 3]);
}
vec2 ${name}_moment(int probe, vec3 d) {
  vec3 p = d / (abs(d.x) + abs(d.y) + abs(d.z));
  vec2 fold = (1.0 - abs(p.yx)) * vec2(p.x >= 0.0 ? 1.0 : -1.0, p.y >= 0.0 ? 1.0 : -1.0);
  vec2 at = ((p.z < 0.0 ? fold : p.xy) + 1.0) * ${SIDE / 2}.0 - 0.5;
  ivec2 low = ivec2(floor(at));
  vec2 f = at - vec2(low);
  vec2 a = mix(${name}_texel(probe, low), ${name}_texel(probe, low + ivec2(1, 0)), f.x);
  vec2 b = mix(${name}_texel(probe, low + ivec2(0, 1)), ${name}_texel(probe, low + ivec2(1, 1)), f.x);
  return mix(a, b, f.y);
}
vec4 ${name}_moments(vec3 place, vec3 n, ivec3 cell, vec3 f) {
  vec4 total = vec4(0.0);
  for (int k = 0; k < 8; k++) {
    ivec3 c = ivec3(k & 1, (k >> 1) & 1, k >> 2), q = cell + c;
    int probe = (q.z * ${ny} + q.y) * ${nx} + q.x;
    uvec4 head = ${name}_word(${first} + probe * ${ROW});
    if (head.w == 0u) continue;
    vec3 way = uintBitsToFloat(head.xyz) - place;
    float far = max(length(way), 1e-9), r = far * float(${1 / file.spacing});
    float wrap = 0.5 * dot(way, n) / far + 0.5;
    vec2 m = ${name}_moment(probe, -way / far);
    float variance = abs(m.x * m.x - m.y), gap = r - m.x;
    float chance = variance / max(variance + gap * gap, 1e-12);
    float w = (wrap * wrap + 0.2) * (r > m.x ? max(chance * chance * chance, 0.05) : 1.0);
    w = max(w, 1e-6);
    w = w < 0.2 ? w * w * w * 25.0 : w;
    vec3 h = max(1.0 - abs(f - vec3(c)), 1e-3);
    w *= h.x * h.y * h.z;
    if (probe == ${name}_probe) ${name}_share += w;
    total += vec4(w * ${name}_light(probe), w);
  }
  return total;
}`;
}
