/**
 * What a frame of the lens takes, as data: buffers, shaders, and the order in which they run. `Lens` carries it out in the
 * browser; `benchmarks/gpu_lens.py` does through wgpu.
 */

import { type SpreadletLibrary, turns } from "./library.ts";
import { fastSize } from "./sizes.ts";
import { composite, type PictureFormat } from "./wgsl-composite.ts";
import { BEHIND, COARSEN_FIRST, COARSEN_NEXT, coarser, FLOOD, REFINE, SEED } from "./wgsl-fill.ts";
import { FRAME_BYTES, STATS_WORDS } from "./wgsl-frame.ts";
import { CHOOSE, EDGES, GATHER, RANGE } from "./wgsl-gather.ts";
import { type Part, type LibrarySlot, splat } from "./wgsl-splat.ts";
import { columnsSolve, rowsBack, rowsForward, table } from "./wgsl-transform.ts";

/** How a shader sees one of its bindings, in their order. */
export type BindingKind = "uniform" | "read" | "write" | "texture" | "picture";

export interface PlannedShader {
  readonly code: string;
  readonly bindings: readonly BindingKind[];
}

/** Bytes, and what they hold at first; a buffer without data begins with zeros. */
export interface PlannedBuffer {
  readonly bytes: number;
  readonly data?: ArrayBufferView;
}

/** Zero a buffer, or run a shader on named buffers and textures (`color`, `depth`, `motion`, `picture`). */
export type Step =
  | { readonly clear: string }
  | { readonly shader: string; readonly uses: readonly string[]; readonly groups: readonly [number, number, number] };

/** What may be chosen when a lens is made. */
export interface PlanOptions {
  readonly width: number;
  readonly height: number;
  /** Library for pixels at rest: family `depth` or `cats-eye`. */
  readonly still: SpreadletLibrary | null;
  /** Library for pixels that move: family `depth-speed` or `shaped-speed`. */
  readonly moving: SpreadletLibrary | null;
  readonly layers: 1 | 2;
  /** Blur and motion are cut to this, px. */
  readonly largest: number;
  readonly longest: number;
  /** Light from outside the picture: its border repeated. */
  readonly extend: boolean;
  readonly format: PictureFormat;
  /** Whether the device is a rasteriser on the processor. */
  readonly software?: boolean;
}

export interface Plan {
  readonly options: PlanOptions;
  /** Size of the charge image, where the picture begins in it, and how far pixels outside shine. */
  readonly domain: readonly [number, number];
  readonly guard: number;
  readonly extend: number;
  readonly buffers: Readonly<Record<string, PlannedBuffer>>;
  readonly shaders: Readonly<Record<string, PlannedShader>>;
  readonly steps: readonly Step[];
}

/** Longest line that fits the workgroup memory that every WebGPU device has, 16 KiB. */
export const MOST_LINE = 2048;

const groups = (n: number, size: number): number => Math.ceil(n / size);

/** Plan a lens for frames of one size. */
export function plan(options: PlanOptions): Plan {
  const { width, height, still, moving, layers, format, software = false } = options;
  const libraries = [still, moving].filter((one) => one !== null);
  const extend = options.extend ? Math.ceil(options.largest + (moving ? options.longest / 2 : 0)) : 0;
  const guard = extend + Math.max(...libraries.map((one) => reachOf(one, options.largest))) + 1;
  // On a torus what leaves to the right comes back in the left guard, where nobody looks: one guard is enough for both sides.
  // Above and below there are two, whose outermost rows are dark and tell the level.
  const domain = [fastSize(width + guard), fastSize(height + 2 * guard)] as const;
  const slots = new LibrarySlots();
  const stillSlot = still && slots.put(still);
  const movingSlot = moving && slots.put(moving);
  const pixels = width * height;
  const buffers: Record<string, PlannedBuffer> = {
    frame: { bytes: FRAME_BYTES },
    light: { bytes: 16 * pixels },
    place: { bytes: 16 * pixels },
    stats: { bytes: 4 * STATS_WORDS },
    cut: { bytes: 32 },
    ...slots.buffers(),
    columns: of(table(domain[1])),
    rows: of(table(domain[0])),
  };
  const shaders: Record<string, PlannedShader> = {
    gather: { code: GATHER, bindings: ["uniform", "texture", "texture", "texture", "write", "write", "write"] },
    choose: { code: CHOOSE, bindings: ["uniform", "write", "write"] },
    forward: { code: rowsForward(domain[0], software), bindings: ["uniform", "read", "write"] },
    solve: { code: columnsSolve(domain[1], software), bindings: ["uniform", "read", "write", "write", "read"] },
    back: { code: rowsBack(domain[0], software), bindings: ["uniform", "read", "write", "write"] },
    composite: { code: composite(layers, format), bindings: ["uniform", "picture", "read", ...(layers === 2 ? (["read", "read", "read", "write"] as const) : [])] },
  };
  const tiles = [groups(width, 64), groups(height, 64), 1] as const;
  const steps: Step[] = [
    { clear: "stats" },
    { shader: "gather", uses: ["frame", "color", "depth", "motion", "light", "place", "stats"], groups: tiles },
  ];
  const parts: readonly Part[] = layers === 2 ? ["front", "behind"] : ["all"];
  if (layers === 2) {
    shaders.range = { code: RANGE, bindings: ["uniform", "write", "write"] };
    shaders.edges = { code: EDGES, bindings: ["uniform", "write", "write", "read"] };
    steps.push({ shader: "range", uses: ["frame", "stats", "cut"], groups: [1, 1, 1] });
    steps.push({ shader: "edges", uses: ["frame", "stats", "cut", "place"], groups: tiles });
  }
  steps.push({ shader: "choose", uses: ["frame", "stats", "cut"], groups: [1, 1, 1] });
  const seeds = layers === 2 ? fillBehind(options, buffers, shaders, steps) : null;
  for (const part of parts) {
    const [image, still_] = [`image_${part}`, `still_${part}`];
    buffers[image] = { bytes: 32 * domain[0] * domain[1] };
    buffers[still_] = { bytes: 32 };
    const sources = part === "behind" ? ["behind_light", "behind_place"] : ["light", "place"];
    shaders[`splat_${part}`] = {
      code: splat(part, stillSlot, movingSlot),
      bindings: ["uniform", "read", "read", "read", "read", "read", "read", "write"],
    };
    const area = [groups(width + 2 * extend, 8), groups(height + 2 * extend, 8), 1] as const;
    steps.push({ clear: image });
    steps.push({ shader: `splat_${part}`, uses: ["frame", "cut", ...sources, "axes", "records", "points", image], groups: area });
    steps.push({ shader: "forward", uses: ["frame", "rows", image], groups: [domain[1], 2, 1] });
    steps.push({ shader: "solve", uses: ["frame", "columns", image, still_, "rows"], groups: [domain[0], 2, 1] });
    steps.push({ shader: "back", uses: ["frame", "rows", image, still_], groups: [height, 2, 1] });
  }
  const layered = [...parts.map((part) => `image_${part}`), ...(seeds ? ["cut", "place", seeds] : [])];
  steps.push({ shader: "composite", uses: ["frame", "picture", ...layered], groups: [groups(width, 8), groups(height, 8), 1] });
  return { options, domain, guard, extend, buffers, shaders, steps };
}

const of = (data: ArrayBufferView): PlannedBuffer => ({ bytes: data.byteLength, data });

/** Farthest that a point of the nodes up to a radius lies; two more where points are turned. */
function reachOf(library: SpreadletLibrary, largest: number): number {
  const radius = library.axes[0];
  const past = radius.findIndex((value) => value >= largest);
  return library.reach[past < 0 ? radius.length - 1 : past]! + (turns(library.family) ? 2 : 0);
}

/** Several libraries in the same three buffers. */
class LibrarySlots {
  private readonly axes: number[] = [];
  private readonly records: number[] = [];
  private readonly points: Uint32Array[] = [];

  put(library: SpreadletLibrary): LibrarySlot {
    const axes = library.axes.map((axis) => this.axes.push(...axis) - axis.length) as [number, number, number];
    const records = this.records.length / 4;
    const words = this.points.reduce((n, one) => n + one.length, 0);
    const bits = new Uint32Array(new Float32Array(1).buffer);
    const float = new Float32Array(bits.buffer);
    const asBits = (value: number): number => {
      float[0] = value;
      return bits[0]!;
    };
    library.main.forEach((main, node) => {
      for (const one of [main, library.fine[node]!]) {
        if (one) this.records.push(one.first, (one.count | (one.charge ? 0 : 1 << 31)) >>> 0, asBits(one.scale), asBits(one.peak));
        else this.records.push(0, 0, 0, 0);
      }
    });
    this.points.push(library.points);
    return { library, axes, records, words };
  }

  buffers(): Record<"axes" | "records" | "points", PlannedBuffer> {
    const points = new Uint32Array(this.points.reduce((n, one) => n + one.length, 0));
    let at = 0;
    for (const one of this.points) {
      points.set(one, at);
      at += one.length;
    }
    return { axes: of(Float32Array.from(this.axes)), records: of(Uint32Array.from(this.records)), points: of(points) };
  }
}

/** Steps that continue the back layer behind the front one; returns the buffer of nearest pixels. */
function fillBehind(options: PlanOptions, buffers: Record<string, PlannedBuffer>, shaders: Record<string, PlannedShader>, steps: Step[]): string {
  const { width, height } = options;
  const levels = Math.max(1, Math.ceil(Math.log2(Math.max(width, height))));
  const sizes: [number, number, number][] = [[width, height, 0]];
  let texels = 0;
  for (let i = 0; i < levels; i++) {
    const [w, h] = sizes[i]!;
    sizes.push([coarser(w), coarser(h), texels]);
    texels += coarser(w) * coarser(h);
  }
  for (const name of ["coarse_a", "coarse_b", "result_a", "result_b"]) buffers[name] = { bytes: 16 * texels };
  for (const name of ["behind_light", "behind_place"]) buffers[name] = { bytes: 16 * width * height };
  sizes.forEach((size, i) => {
    const next = sizes[i + 1] ?? [0, 0, 0];
    buffers[`level${i}`] = of(Uint32Array.from([...size, 0, ...next, i === levels ? 1 : 0]));
  });
  shaders.coarsen_first = { code: COARSEN_FIRST, bindings: ["uniform", "uniform", "read", "read", "read", "write", "write"] };
  shaders.coarsen_next = { code: COARSEN_NEXT, bindings: ["uniform", "read", "write", "write"] };
  shaders.refine = { code: REFINE, bindings: ["uniform", "read", "write", "write", "write", "write"] };
  shaders.seed = { code: SEED, bindings: ["uniform", "read", "read", "write"] };
  shaders.flood = { code: FLOOD, bindings: ["uniform", "uniform", "read", "write", "write"] };
  shaders.behind = { code: BEHIND, bindings: ["uniform", "uniform", "read", "read", "read", ...new Array<"write">(5).fill("write")] };
  const over = (i: number) => [groups(sizes[i]![0], 8), groups(sizes[i]![1], 8), 1] as const;
  const pyramid = ["coarse_a", "coarse_b"];
  const results = ["result_a", "result_b"];
  steps.push({ shader: "coarsen_first", uses: ["frame", "level0", "cut", "light", "place", ...pyramid], groups: over(1) });
  for (let i = 1; i < levels; i++) steps.push({ shader: "coarsen_next", uses: [`level${i}`, "cut", ...pyramid], groups: over(i + 1) });
  for (let i = levels; i > 0; i--) steps.push({ shader: "refine", uses: [`level${i}`, "cut", ...pyramid, ...results], groups: over(i) });
  const seeds = flood(options, buffers, steps);
  steps.push({ shader: "behind", uses: ["frame", "level0", "cut", "light", "place", ...results, seeds, "behind_light", "behind_place"], groups: over(0) });
  return seeds;
}

/** Steps that find the nearest seen pixel within the reach of blur and motion; returns the buffer that holds it. */
function flood({ width, height, largest, moving, longest }: PlanOptions, buffers: Record<string, PlannedBuffer>, steps: Step[]): string {
  const area = [groups(width, 8), groups(height, 8), 1] as const;
  const reach = largest + (moving ? longest / 2 : 0) + 4;
  const pair = ["seeds_a", "seeds_b"];
  for (const name of pair) buffers[name] = { bytes: 8 * width * height };
  steps.push({ shader: "seed", uses: ["frame", "cut", "place", "seeds_a"], groups: area });
  // Jumps of 2^n, …, 2, 1 see 2^(n+1) - 1 far; one more of 1 mends most of what they miss.
  const jumps = [1, 1];
  while (2 * jumps[0]! - 1 < reach) jumps.unshift(2 * jumps[0]!);
  jumps.forEach((step, i) => {
    buffers[`jump${i}`] = of(Int32Array.of(step, 0, 0, 0));
    steps.push({ shader: "flood", uses: ["frame", `jump${i}`, "cut", pair[i % 2]!, pair[(i + 1) % 2]!], groups: area });
  });
  return pair[jumps.length % 2]!;
}
