/**
 * WGSL of the exact solve: Fourier transforms of rows and columns in workgroup memory (Stockham, mixed radix), divided by the
 * eigenvalues of the five-point Laplacian on a torus. Two channels are the real and the imaginary part of one transform:
 * the eigenvalues are real and even, so that they never mix.
 */

import { radices } from "./sizes.ts";
import { FRAME } from "./wgsl-frame.ts";

/** Threads of a workgroup for lines of n. A rasteriser on the processor switches between them at every barrier: few are better. */
export const threadsFor = (n: number, software: boolean): number => (software ? 16 : n <= 512 ? 64 : n <= 2048 ? 128 : 256);

/** cos, −sin of 2πk/n, and 4 sin²(πk/n). */
export function table(n: number): Float32Array {
  const values = new Float32Array(4 * n);
  for (let k = 0; k < n; k++) {
    const angle = (2 * Math.PI * k) / n;
    values.set([Math.cos(angle), -Math.sin(angle), 4 * Math.sin(angle / 2) ** 2, 0], 4 * k);
  }
  return values;
}

const BUTTERFLIES: Record<number, (v: string[]) => string> = {
  2: ([a, b]) => `{ let p = ${a}; ${a} = p + ${b}; ${b} = p - ${b}; }`,
  3: ([a, b, c]) => `{
      let s = ${b} + ${c}; let d = turned(${b} - ${c}) * ${Math.sqrt(3) / 2};
      let m = ${a} - 0.5 * s;
      ${a} += s; ${b} = m + d; ${c} = m - d;
    }`,
  4: ([a, b, c, d]) => `{
      let p = ${a} + ${c}; let q = ${a} - ${c}; let r = ${b} + ${d}; let s = turned(${b} - ${d});
      ${a} = p + r; ${b} = q + s; ${c} = p - r; ${d} = q - s;
    }`,
  5: ([a, b, c, d, e]) => {
    const [c1, c2, s1, s2] = [1, 2].map((k) => Math.cos((2 * Math.PI * k) / 5)).concat([1, 2].map((k) => Math.sin((2 * Math.PI * k) / 5)));
    return `{
      let p = ${b} + ${e}; let q = ${c} + ${d}; let r = turned(${b} - ${e}); let s = turned(${c} - ${d});
      let m = ${a} + ${c1} * p + ${c2} * q; let n = ${a} + ${c2} * p + ${c1} * q;
      let u = ${s1} * r + ${s2} * s; let w = ${s2} * r - ${s1} * s;
      ${a} += p + q; ${b} = m + u; ${e} = m - u; ${c} = n + w; ${d} = n - w;
    }`;
  },
};

/** One pass over the line: every thread holds its butterflies in registers between two barriers. */
function stage(n: number, radix: number, done: number, threads: number): string {
  const butterflies = n / radix;
  const rounds = Math.ceil(butterflies / threads);
  const name = (round: number) => Array.from({ length: radix }, (_, k) => `v${round}_${k}`);
  const guard = (round: number, text: string) => ((round + 1) * threads <= butterflies ? `{ ${text} }` : `if (t + ${round * threads}u < ${butterflies}u) { ${text} }`);
  let code = "{\n";
  for (let round = 0; round < rounds; round++) {
    const v = name(round);
    code += v.map((one) => `var ${one} = vec2f(0.0);`).join(" ");
    const reads = v.map((one, k) => `${one} = line[j + ${k * butterflies}u];`).join(" ");
    const turn = done > 1 ? v.slice(1).map((one, k) => `${one} = times(${one}, circle[(j % ${done}u) * ${(k + 1) * (n / (done * radix))}u].xy);`).join(" ") : "";
    code += guard(round, `let j = t + ${round * threads}u; ${reads} ${turn} ${BUTTERFLIES[radix]!(v)}`);
  }
  code += "\nworkgroupBarrier();\n";
  for (let round = 0; round < rounds; round++) {
    const writes = name(round).map((one, k) => `line[at + ${k * done}u] = ${one};`).join(" ");
    code += guard(round, `let j = t + ${round * threads}u; let at = (j / ${done}u) * ${done * radix}u + j % ${done}u; ${writes}`);
  }
  return `${code}\nworkgroupBarrier();\n}\n`;
}

function transform(n: number, software: boolean): string {
  const threads = threadsFor(n, software);
  let done = 1;
  let code = "";
  for (const radix of radices(n)!) {
    code += stage(n, radix, done, threads);
    done *= radix;
  }
  return /* wgsl */ `
const THREADS = ${threads}u;
var<workgroup> line: array<vec2f, ${n}>;
fn times(a: vec2f, b: vec2f) -> vec2f { return vec2f(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x); }
/** A quarter turn back: times -i. */
fn turned(a: vec2f) -> vec2f { return vec2f(a.y, -a.x); }
/** The forward transform of the line, in place. The inverse is the same with real and imaginary parts swapped. */
fn transform(t: u32) {
workgroupBarrier();
${code}}
`;
}

const HEAD = (n: number, software: boolean): string => /* wgsl */ `
${FRAME}
@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> circle: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> image: array<vec2i>;
${transform(n, software)}`;

const STILL = /* wgsl */ `
@group(0) @binding(3) var<storage, read_write> still: array<vec2f>;   // of each pair: zero frequency of the first and last row
`;

/** Rows of integer charges to frequencies along x. Workgroups: rows × pairs. */
export const rowsForward = (n: number, software: boolean): string => /* wgsl */ `
${HEAD(n, software)}
@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) t: u32) {
  let start = (group.y * frame.domain.y + group.x) * ${n}u;
  for (var k = t; k < ${n}u; k += THREADS) { line[k] = vec2f(image[start + k]) * exp2(-16.0); }
  transform(t);
  for (var k = t; k < ${n}u; k += THREADS) { image[start + k] = bitcast<vec2i>(line[k]); }
}
`;

/** Columns: to frequencies, divided by the eigenvalues, and back. Workgroups: columns × pairs. */
export const columnsSolve = (n: number, software: boolean): string => /* wgsl */ `
${HEAD(n, software)}${STILL}
@group(0) @binding(4) var<storage, read> across: array<vec4f>;
@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) t: u32) {
  let width = frame.domain.x;
  let start = group.y * ${n}u * width + group.x;
  for (var k = t; k < ${n}u; k += THREADS) { line[k] = bitcast<vec2f>(image[start + k * width]); }
  transform(t);
  let along = across[group.x].z;
  for (var k = t; k < ${n}u; k += THREADS) {
    let value = line[k] / max((along + circle[k].z) * f32(width * ${n}u), 1e-30);
    line[k] = select(value.yx, vec2f(0.0), k == 0u && group.x == 0u);
  }
  transform(t);
  for (var k = t; k < ${n}u; k += THREADS) { image[start + k * width] = bitcast<vec2i>(line[k].yx); }
  if (group.x == 0u && t == 0u) {
    still[2u * group.y] = line[0].yx;
    still[2u * group.y + 1u] = line[${n - 1}].yx;
  }
}
`;

/** Rows of the picture back from frequencies, less the value at its edge, which is zero. Workgroups: rows × pairs. */
export const rowsBack = (n: number, software: boolean): string => /* wgsl */ `
${HEAD(n, software)}${STILL}
@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) t: u32) {
  let row = group.x + u32(frame.guard);
  let start = (group.y * frame.domain.y + row) * ${n}u;
  let level = 0.5 * (still[2u * group.y] + still[2u * group.y + 1u]);
  for (var k = t; k < ${n}u; k += THREADS) { line[k] = bitcast<vec2f>(image[start + k]).yx; }
  transform(t);
  for (var k = t; k < ${n}u; k += THREADS) { image[start + k] = bitcast<vec2i>(line[k].yx - level); }
}
`;
