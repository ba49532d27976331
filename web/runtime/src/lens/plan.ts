/**
 * What a frame of the lens takes, as data: buffers, shaders, and the order in which they run. `Lens` carries it out in the
 * browser; `benchmarks/gpu_lens.py` does through wgpu.
 */

import { type SpreadletLibrary, turns } from "./library.ts";
import { fastSize } from "./sizes.ts";
import { accumulate, composite, type PictureFormat } from "./wgsl-composite.ts";
import { BEHIND, COARSEN_FIRST, COARSEN_NEXT, coarser, FLOOD, REFINE, SEED } from "./wgsl-fill.ts";
import { FRAME_BYTES, MOST_LAYERS, STATS_WORDS } from "./wgsl-frame.ts";
import { BORDER, CHOOSE, EDGES, GATHER, RANGE } from "./wgsl-gather.ts";
import { type LibrarySlot, splat } from "./wgsl-splat.ts";
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
  /** Depth layers, 1 to 4. */
  readonly layers: number;
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

/** Layers as they may be asked for; throws unless they are. */
export function checkLayers(layers: number): number {
  if (Number.isInteger(layers) && layers >= 1 && layers <= MOST_LAYERS) return layers;
  throw new RangeError(`lens: ${layers} layers; use 1 to ${MOST_LAYERS}`);
}

const groups = (n: number, size: number): number => Math.ceil(n / size);

/** Plan a lens for frames of one size. */
export function plan(options: PlanOptions): Plan {
  const { width, height, still, moving, format, software = false } = options;
  const layers = checkLayers(options.layers);
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
    cuts: { bytes: 32 },
    image: { bytes: 32 * domain[0] * domain[1] },
    still: { bytes: 32 },
    ...slots.buffers(),
    columns: of(table(domain[1])),
    rows: of(table(domain[0])),
  };
  const shaders: Record<string, PlannedShader> = {
    gather: { code: GATHER, bindings: ["uniform", "texture", "texture", "texture", "write", "write", "write"] },
    border: { code: BORDER, bindings: ["uniform", "write", "write"] },
    splat: { code: splat(stillSlot, movingSlot), bindings: ["uniform", "uniform", ...Array<"read">(6).fill("read"), "write"] },
    forward: { code: rowsForward(domain[0], software), bindings: ["uniform", "read", "write"] },
    solve: { code: columnsSolve(domain[1], software), bindings: ["uniform", "read", "write", "write", "read"] },
    back: { code: rowsBack(domain[0], software), bindings: ["uniform", "read", "write", "write"] },
    composite: { code: composite(layers, format), bindings: ["uniform", "picture", "read", ...Array<"read">(layers > 1 ? 3 : 0).fill("read")] },
  };
  const tiles = [groups(width, 64), groups(height, 64), 1] as const;
  const steps: Step[] = [
    { clear: "stats" },
    { shader: "gather", uses: ["frame", "color", "depth", "motion", "light", "place", "stats"], groups: tiles },
  ];
  if (layers > 1) findCuts(layers, tiles, shaders, steps);
  steps.push({ shader: "border", uses: ["frame", "stats", "cuts"], groups: [1, 1, 1] });
  const fill = layers > 1 ? new Fill(options, buffers, shaders) : null;
  if (layers > 1) {
    shaders.accumulate = { code: accumulate(layers), bindings: ["uniform", "uniform", "read", "read", "read", "read", "write", "write"] };
    buffers.behind = { bytes: 16 * pixels };
  }
  const area = [groups(width + 2 * extend, 8), groups(height + 2 * extend, 8), 1] as const;
  const over = [groups(width, 8), groups(height, 8), 1] as const;
  // Back to front, so that one image serves all layers.
  for (let number = layers - 1; number >= 0; number--) {
    const part = `part${number}`;
    buffers[part] = of(Uint32Array.of(number, 0, 0, 0));
    const seeds = number > 0 ? fill!.steps(part, steps) : null;
    const sources = number > 0 ? ["filled_light", "filled_place"] : ["light", "place"];
    steps.push({ clear: "image" });
    steps.push({ shader: "splat", uses: ["frame", part, "cuts", ...sources, "axes", "records", "points", "image"], groups: area });
    steps.push({ shader: "forward", uses: ["frame", "rows", "image"], groups: [domain[1], 2, 1] });
    steps.push({ shader: "solve", uses: ["frame", "columns", "image", "still", "rows"], groups: [domain[0], 2, 1] });
    steps.push({ shader: "back", uses: ["frame", "rows", "image", "still"], groups: [height, 2, 1] });
    if (seeds) steps.push({ shader: "accumulate", uses: ["frame", part, "cuts", "image", "filled_place", seeds, "place", "behind"], groups: over });
  }
  const layered = layers > 1 ? ["cuts", "place", "behind"] : [];
  steps.push({ shader: "composite", uses: ["frame", "picture", "image", ...layered], groups: over });
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

/** Steps that find where to cut a frame into layers, one cut after the other. */
function findCuts(layers: number, tiles: readonly [number, number, number], shaders: Record<string, PlannedShader>, steps: Step[]): void {
  shaders.range = { code: RANGE, bindings: ["uniform", "write", "write"] };
  shaders.edges = { code: EDGES, bindings: ["uniform", "write", "write", "read"] };
  shaders.choose = { code: CHOOSE, bindings: ["uniform", "write", "write"] };
  steps.push({ shader: "range", uses: ["frame", "stats", "cuts"], groups: [1, 1, 1] });
  for (let cut = 1; cut < layers; cut++) {
    steps.push({ shader: "edges", uses: ["frame", "stats", "cuts", "place"], groups: tiles });
    steps.push({ shader: "choose", uses: ["frame", "stats", "cuts"], groups: [1, 1, 1] });
  }
}

/** Continues layers behind those in front of them, each in the same buffers. */
class Fill {
  private readonly levels: number;
  private readonly over: readonly (readonly [number, number, number])[];
  /** Distances of the flood's jumps, px. */
  private readonly jumps: readonly number[];

  constructor(options: PlanOptions, buffers: Record<string, PlannedBuffer>, shaders: Record<string, PlannedShader>) {
    const { width, height, largest, longest, moving } = options;
    this.levels = Math.max(1, Math.ceil(Math.log2(Math.max(width, height))));
    const sizes: [number, number, number][] = [[width, height, 0]];
    let texels = 0;
    for (let i = 0; i < this.levels; i++) {
      const [w, h] = sizes[i]!;
      sizes.push([coarser(w), coarser(h), texels]);
      texels += coarser(w) * coarser(h);
    }
    this.over = sizes.map(([w, h]) => [groups(w, 8), groups(h, 8), 1] as const);
    for (const name of ["coarse_a", "coarse_b", "result_a", "result_b"]) buffers[name] = { bytes: 16 * texels };
    for (const name of ["filled_light", "filled_place"]) buffers[name] = { bytes: 16 * width * height };
    for (const name of ["seeds_a", "seeds_b"]) buffers[name] = { bytes: 8 * width * height };
    sizes.forEach((size, i) => {
      const next = sizes[i + 1] ?? [0, 0, 0];
      buffers[`level${i}`] = of(Uint32Array.from([...size, 0, ...next, i === this.levels ? 1 : 0]));
    });
    // Jumps of 2^n, …, 2, 1 see 2^(n+1) - 1 far; one more of 1 mends most of what they miss.
    const reach = largest + (moving ? longest / 2 : 0) + 4;
    const jumps = [1, 1];
    while (2 * jumps[0]! - 1 < reach) jumps.unshift(2 * jumps[0]!);
    jumps.forEach((step, i) => (buffers[`jump${i}`] = of(Int32Array.of(step, 0, 0, 0))));
    this.jumps = jumps;
    shaders.coarsen_first = { code: COARSEN_FIRST, bindings: ["uniform", "uniform", "uniform", "read", "read", "read", "write", "write"] };
    shaders.coarsen_next = { code: COARSEN_NEXT, bindings: ["uniform", "uniform", "read", "write", "write"] };
    shaders.refine = { code: REFINE, bindings: ["uniform", "uniform", "read", "write", "write", "write", "write"] };
    shaders.seed = { code: SEED, bindings: ["uniform", "uniform", "read", "read", "write"] };
    shaders.flood = { code: FLOOD, bindings: ["uniform", "uniform", "uniform", "read", "write", "write"] };
    shaders.behind = { code: BEHIND, bindings: ["uniform", "uniform", "uniform", "read", "read", "read", ...Array<"write">(5).fill("write")] };
  }

  /** Add the steps of a layer, named by its uniform block; returns the buffer of nearest pixels. */
  steps(part: string, steps: Step[]): string {
    const { levels, over } = this;
    const pyramid = ["coarse_a", "coarse_b"];
    const results = ["result_a", "result_b"];
    steps.push({ shader: "coarsen_first", uses: ["frame", "level0", part, "cuts", "light", "place", ...pyramid], groups: over[1]! });
    for (let i = 1; i < levels; i++) steps.push({ shader: "coarsen_next", uses: [`level${i}`, part, "cuts", ...pyramid], groups: over[i + 1]! });
    for (let i = levels; i > 0; i--) steps.push({ shader: "refine", uses: [`level${i}`, part, "cuts", ...pyramid, ...results], groups: over[i]! });
    const seeds = this.flood(part, steps);
    steps.push({ shader: "behind", uses: ["frame", "level0", part, "cuts", "light", "place", ...results, seeds, "filled_light", "filled_place"], groups: over[0]! });
    return seeds;
  }

  /** Add the steps that find the nearest seen pixel within the reach of blur and motion. */
  private flood(part: string, steps: Step[]): string {
    const pair = ["seeds_a", "seeds_b"];
    const area = this.over[0]!;
    steps.push({ shader: "seed", uses: ["frame", part, "cuts", "place", "seeds_a"], groups: area });
    this.jumps.forEach((_, i) => steps.push({ shader: "flood", uses: ["frame", `jump${i}`, part, "cuts", pair[i % 2]!, pair[(i + 1) % 2]!], groups: area }));
    return pair[this.jumps.length % 2]!;
  }
}
