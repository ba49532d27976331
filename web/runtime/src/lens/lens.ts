/** Depth of field and motion blur in one pass, on WebGPU, from a colour and a depth texture. */

import type { DepthMeaning, LensCamera } from "./camera.ts";
import { type Edges, frameBlock, positive } from "./frame-block.ts";
import { type SpreadletLibrary } from "./library.ts";
import { type BindingKind, checkLayers, MOST_LINE, type Plan, plan, type PlannedShader } from "./plan.ts";
import type { PictureFormat } from "./wgsl-composite.ts";

/** What stays the same from frame to frame. */
export interface LensOptions {
  /** Spreadlets, of one or two libraries: one without motion, one with it. */
  readonly libraries: readonly SpreadletLibrary[];
  /** Depth layers, 1 to 4; one ignores who covers whom. Each takes a scatter and a solve, and no memory. */
  readonly layers?: number;
  /** Blur is cut to this radius, px; by default as far as the library reaches. */
  readonly largest?: number;
  /** Motion is cut to this length, px; by default as far as the library reaches. */
  readonly longest?: number;
  readonly edges?: Edges;
  /** Format of the picture: a storage texture. */
  readonly format?: PictureFormat;
  /** Error in whites at which a bright pixel takes exact points. */
  readonly tolerance?: number;
}

/** One frame. Textures are of one size; the colour is linear light, premultiplied. */
export interface LensFrame {
  readonly color: GPUTexture;
  /** A depth format, or distances in the first channel of a float format. */
  readonly depth: GPUTexture;
  readonly depthMeaning: DepthMeaning;
  /** Displacement in the first two channels, forward in time. */
  readonly motion?: GPUTexture | null;
  /** Pixels (x right, y down) per unit of the motion texture, per frame; the camera's shutter comes on top. */
  readonly motionScale?: readonly [number, number];
  readonly camera?: Partial<LensCamera>;
  /** Whether alpha is taken as 1 everywhere; true by default. */
  readonly opaque?: boolean;
  /** Scene-referred value that shows as white; 1 by default. */
  readonly white?: number;
  /** Circle of confusion where two layers part, px; cuts are found by themselves where it is absent. */
  readonly cut?: number | null;
  /** Number of the frame; changes the dither. */
  readonly number?: number;
  /** The picture: a texture that may be written as storage, of the lens' format. */
  readonly picture: GPUTexture;
}

/** Blur that a library without an axis can do is this at most, px. */
const LONGEST_AXIS = 1;

/** What a frame met. */
export interface LensReport {
  /** Pixels without usable colour, depth or motion; a neighbour took their place. */
  readonly bad: number;
  /** Pixels whose blur or motion was larger than the libraries reach, and cut. */
  readonly clamped: number;
  /** Circles of confusion where layers part, px, front to back. */
  readonly cuts: readonly number[];
}

/** A lens on a device. Make it with `Lens.create`, call `encode` for each frame and `dispose` at the end. */
export class Lens {
  readonly device: GPUDevice;
  readonly format: PictureFormat;
  /** Blur and motion are cut here, px. */
  readonly largest: number;
  readonly longest: number;
  private readonly options: LensOptions;
  private readonly still: SpreadletLibrary | null;
  private readonly moving: SpreadletLibrary | null;
  /** What belongs to one size of frames. */
  private fitted: Fitted | null = null;
  private noMotion: GPUTexture | null = null;
  private disposed = false;

  /** Shaders are compiled when the first frame comes; `Lens.create` compiles them before. */
  constructor(device: GPUDevice, options: LensOptions) {
    this.device = device;
    this.options = options;
    this.format = options.format ?? "rgba16float";
    const moves = (one: SpreadletLibrary) => one.family === "depth-speed" || one.family === "shaped-speed";
    this.still = options.libraries.find((one) => !moves(one)) ?? null;
    this.moving = options.libraries.find(moves) ?? null;
    if ((!this.still && !this.moving) || options.libraries.length > 2) throw new RangeError("lens: give one library, or one without and one with motion");
    const radii = [this.still, this.moving].filter((one) => one !== null).map((one) => one.axes[0].at(-1)!);
    this.largest = positive(Math.min(options.largest ?? Infinity, ...radii), "largest blur");
    checkLayers(options.layers ?? 2);
    this.longest = this.moving ? positive(Math.min(options.longest ?? Infinity, this.moving.axes[1].at(-1)!), "longest motion") : LONGEST_AXIS;
  }

  /** A lens with its shaders compiled for frames of a size; other sizes are compiled when they come. */
  static async create(device: GPUDevice, options: LensOptions, width: number, height: number): Promise<Lens> {
    const lens = new Lens(device, options);
    const planned = lens.plan(width, height);
    const pipelines = await Promise.all(
      Object.entries(planned.shaders).map(async ([name, shader]) => {
        const layout = layoutOf(device, shader, lens.format);
        return [name, { layout, pipeline: await device.createComputePipelineAsync(describe(device, name, shader, layout)) }] as const;
      }),
    );
    lens.fitted = new Fitted(device, planned, new Map(pipelines));
    return lens;
  }

  /** Whether pixels that move are blurred along their motion. */
  get blursMotion(): boolean {
    return this.moving !== null;
  }

  /** Add the work of a frame to an encoder; the picture is there when the device has done it. */
  encode(encoder: GPUCommandEncoder, frame: LensFrame): void {
    if (this.disposed) throw new Error("lens: it was disposed of");
    const { color, depth, motion = null, picture } = frame;
    for (const [name, one] of Object.entries({ depth, motion, picture })) {
      if (one && (one.width !== color.width || one.height !== color.height)) {
        throw new RangeError(`lens: ${name} is ${one.width}x${one.height} and colour ${color.width}x${color.height}; all textures must be of one size`);
      }
    }
    const multisampled = [color, depth, motion].find((one) => one && one.sampleCount > 1);
    if (multisampled) throw new RangeError("lens: a multisampled texture; resolve it first, or draw without antialiasing");
    if (picture.format !== this.format) throw new RangeError(`lens: the picture is ${picture.format}; this lens writes ${this.format}`);
    const fitted = this.fit(color.width, color.height);
    this.device.queue.writeBuffer(fitted.buffers.get("frame")!, 0, this.uniforms(frame, fitted.plan));
    fitted.encode(encoder, { color, depth, motion: motion ?? this.nothing(), picture });
  }

  /** What the last frame met. */
  async report(): Promise<LensReport> {
    const { fitted } = this;
    if (!fitted || this.disposed) return { bad: 0, clamped: 0, cuts: [] };
    const [stats, cuts] = await Promise.all([fitted.read("stats"), fitted.read("cuts")]);
    const [bad, clamped] = new Uint32Array(stats).slice(-2) as unknown as [number, number];
    return { bad, clamped, cuts: [...new Float32Array(cuts, 0, new Uint32Array(cuts)[4]!)] };
  }

  /** What a buffer of the plan holds after the work that was submitted; for tests. */
  read(buffer: string): Promise<ArrayBuffer> {
    if (!this.fitted || this.disposed) throw new Error("lens: nothing was drawn");
    return this.fitted.read(buffer);
  }

  /** The plan for the size of the last frame. */
  get planned(): Plan | null {
    return this.fitted?.plan ?? null;
  }

  /** Free everything on the device. Textures that were given are the caller's. */
  dispose(): void {
    this.disposed = true;
    this.fitted?.dispose();
    this.fitted = null;
    this.noMotion?.destroy();
    this.noMotion = null;
  }

  private plan(width: number, height: number): Plan {
    const { layers = 2, edges = "extend" } = this.options;
    const limit = Math.max(width, height) / 2;
    const planned = plan({
      width,
      height,
      still: this.still,
      moving: this.moving,
      layers,
      largest: Math.min(this.largest, limit),
      longest: Math.min(this.longest, Math.max(width, height)),
      extend: edges === "extend",
      format: this.format,
      software: this.device.adapterInfo?.isFallbackAdapter === true || this.device.adapterInfo?.architecture === "swiftshader",
    });
    checkLimits(planned, this.device.limits);
    return planned;
  }

  private fit(width: number, height: number): Fitted {
    const old = this.fitted?.plan.options;
    if (this.fitted && old?.width === width && old.height === height) return this.fitted;
    const planned = this.plan(width, height);
    const pipelines = new Map(
      Object.entries(planned.shaders).map(([name, shader]) => {
        const layout = layoutOf(this.device, shader, this.format);
        return [name, { layout, pipeline: this.device.createComputePipeline(describe(this.device, name, shader, layout)) }];
      }),
    );
    this.fitted?.dispose();
    this.fitted = new Fitted(this.device, planned, pipelines);
    return this.fitted;
  }

  private nothing(): GPUTexture {
    this.noMotion ??= this.device.createTexture({ label: "lens: no motion", size: [1, 1], format: "rg32float", usage: GPUTextureUsage.TEXTURE_BINDING });
    return this.noMotion;
  }

  private uniforms(frame: LensFrame, planned: Plan): ArrayBuffer {
    const { edges = "extend", tolerance = 1e-3 } = this.options;
    return frameBlock(planned, { ...frame, motion: Boolean(frame.motion) && this.moving !== null, edges, tolerance });
  }
}

interface Stage {
  readonly layout: GPUBindGroupLayout;
  readonly pipeline: GPUComputePipeline;
}

function checkLimits({ buffers, domain }: Plan, limits: GPUSupportedLimits): void {
  const longest = Math.max(...domain);
  const memory = Math.max(8 * longest, 8 * MOST_LINE);
  if (memory > limits.maxComputeWorkgroupStorageSize) {
    throw new RangeError(`lens: lines of ${longest} need ${memory} bytes of workgroup memory; ask for the limit maxComputeWorkgroupStorageSize, or draw a smaller frame`);
  }
  const most = Math.max(...Object.values(buffers).map((one) => one.bytes));
  const allowed = Math.min(limits.maxStorageBufferBindingSize, limits.maxBufferSize);
  if (most > allowed) throw new RangeError(`lens: the frame needs buffers of ${most} bytes and the device allows ${allowed}; ask for the limit maxStorageBufferBindingSize, or draw a smaller frame`);
}

const ENTRIES: Record<BindingKind, (format: PictureFormat) => Partial<GPUBindGroupLayoutEntry>> = {
  uniform: () => ({ buffer: { type: "uniform" } }),
  read: () => ({ buffer: { type: "read-only-storage" } }),
  write: () => ({ buffer: { type: "storage" } }),
  texture: () => ({ texture: { sampleType: "unfilterable-float" } }),
  picture: (format) => ({ storageTexture: { access: "write-only", format } }),
};

function layoutOf(device: GPUDevice, shader: PlannedShader, format: PictureFormat): GPUBindGroupLayout {
  const entries = shader.bindings.map((kind, binding) => ({ binding, visibility: GPUShaderStage.COMPUTE, ...ENTRIES[kind](format) }));
  return device.createBindGroupLayout({ entries });
}

function describe(device: GPUDevice, name: string, shader: PlannedShader, layout: GPUBindGroupLayout): GPUComputePipelineDescriptor {
  return {
    label: `lens: ${name}`,
    layout: device.createPipelineLayout({ bindGroupLayouts: [layout] }),
    compute: { module: device.createShaderModule({ label: `lens: ${name}`, code: shader.code }), entryPoint: "main" },
  };
}

type Textures = Readonly<Record<"color" | "depth" | "motion" | "picture", GPUTexture>>;

/** Buffers and pipelines for frames of one size. */
class Fitted {
  readonly plan: Plan;
  readonly buffers: ReadonlyMap<string, GPUBuffer>;
  private readonly device: GPUDevice;
  private readonly stages: ReadonlyMap<string, Stage>;
  /** Bind groups of steps that touch no texture. */
  private readonly groups = new Map<number, GPUBindGroup>();

  constructor(device: GPUDevice, planned: Plan, stages: ReadonlyMap<string, Stage>) {
    [this.device, this.plan, this.stages] = [device, planned, stages];
    const uniforms = new Set(planned.steps.flatMap((step) => ("clear" in step ? [] : step.uses.filter((_, i) => planned.shaders[step.shader]!.bindings[i] === "uniform"))));
    this.buffers = new Map(
      Object.entries(planned.buffers).map(([name, { bytes, data }]) => {
        const usage = (uniforms.has(name) ? GPUBufferUsage.UNIFORM : GPUBufferUsage.STORAGE) | GPUBufferUsage.COPY_DST | GPUBufferUsage.COPY_SRC;
        const buffer = device.createBuffer({ label: `lens: ${name}`, size: Math.ceil(bytes / 16) * 16, usage });
        if (data) device.queue.writeBuffer(buffer, 0, data.buffer, data.byteOffset, data.byteLength);
        return [name, buffer];
      }),
    );
  }

  encode(encoder: GPUCommandEncoder, textures: Textures): void {
    let pass: GPUComputePassEncoder | null = null;
    this.plan.steps.forEach((step, number) => {
      if ("clear" in step) {
        pass?.end();
        pass = null;
        encoder.clearBuffer(this.buffers.get(step.clear)!);
        return;
      }
      pass ??= encoder.beginComputePass({ label: "lens" });
      pass.setPipeline(this.stages.get(step.shader)!.pipeline);
      pass.setBindGroup(0, this.group(number, step, textures));
      pass.dispatchWorkgroups(...step.groups);
    });
    pass = pass as GPUComputePassEncoder | null;
    pass?.end();
  }

  async read(name: string): Promise<ArrayBuffer> {
    const source = this.buffers.get(name);
    if (!source) throw new RangeError(`lens: no buffer ${name}`);
    const copy = this.device.createBuffer({ size: source.size, usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ });
    const encoder = this.device.createCommandEncoder();
    encoder.copyBufferToBuffer(source, 0, copy, 0, source.size);
    this.device.queue.submit([encoder.finish()]);
    await copy.mapAsync(GPUMapMode.READ);
    const data = copy.getMappedRange().slice(0, this.plan.buffers[name]!.bytes);
    copy.destroy();
    return data;
  }

  dispose(): void {
    for (const buffer of this.buffers.values()) buffer.destroy();
    this.groups.clear();
  }

  private group(number: number, step: Extract<Plan["steps"][number], { shader: string }>, textures: Textures): GPUBindGroup {
    const kept = this.groups.get(number);
    if (kept) return kept;
    const entries = step.uses.map((name, binding) => ({ binding, resource: this.resource(name, textures) }));
    const group = this.device.createBindGroup({ layout: this.stages.get(step.shader)!.layout, entries });
    if (!step.uses.some((name) => name in textures)) this.groups.set(number, group);
    return group;
  }

  private resource(name: string, textures: Textures): GPUBindingResource {
    const buffer = this.buffers.get(name);
    if (buffer) return { buffer };
    const texture = textures[name as keyof Textures];
    return texture.createView(name === "depth" && texture.format.startsWith("depth") ? { aspect: "depth-only" } : {});
  }
}
