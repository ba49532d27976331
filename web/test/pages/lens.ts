/** A page that draws frames with the lens on WebGPU and reads them back. */

import { Lens, type LensCamera, type LensFrame, type LensOptions, type LensReport, readLibrary } from "lightwell/lens";

export interface LensRequest {
  readonly width: number;
  readonly height: number;
  /** Libraries, base64. */
  readonly libraries: readonly string[];
  readonly light: readonly number[];
  /** Distances along the axis, or what `meaning` says. */
  readonly depth: readonly number[];
  readonly motion?: readonly number[] | null;
  readonly options: Omit<LensOptions, "libraries" | "format">;
  readonly camera: Partial<LensCamera>;
  readonly frame?: Partial<Pick<LensFrame, "opaque" | "cut" | "number" | "white" | "depthMeaning">>;
  /** Put the depth into a real depth buffer rather than a float texture. */
  readonly depthBuffer?: boolean;
  /** Buffers to read back. */
  readonly read?: readonly string[];
  /** Text that is replaced in the shaders: a planted bug. */
  readonly plant?: { readonly shader: string; readonly from: string; readonly to: string };
  /** Take the device for a real GPU, whose workgroups are larger. */
  readonly hardware?: boolean;
  /** Shaders that do nothing. */
  readonly idle?: readonly string[];
  /** Frames drawn and waited for, to time them. */
  readonly rounds?: number;
}

export interface LensAnswer {
  readonly picture: number[];
  readonly buffers: Record<string, number[]>;
  readonly guard: number;
  readonly domain: readonly [number, number];
  readonly report: LensReport;
  readonly errors: string[];
  readonly adapter: string;
  readonly milliseconds: number[];
}

const bytes = (text: string) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

let kept: { device: GPUDevice; adapter: string } | null = null;

async function device(): Promise<{ device: GPUDevice; adapter: string }> {
  if (kept) return kept;
  const adapter = await navigator.gpu?.requestAdapter();
  if (!adapter) throw new Error("no adapter");
  const { vendor, architecture, description } = adapter.info;
  const { maxStorageBufferBindingSize, maxBufferSize } = adapter.limits;
  const made = await adapter.requestDevice({ requiredLimits: { maxStorageBufferBindingSize, maxBufferSize } });
  kept = { device: made, adapter: [vendor, architecture, description].filter(Boolean).join(" ") };
  return kept;
}

function upload(gpu: GPUDevice, data: readonly number[], width: number, height: number, channels: 1 | 2 | 4): GPUTexture {
  const format = ({ 1: "r32float", 2: "rg32float", 4: "rgba32float" } as const)[channels];
  const texture = gpu.createTexture({ size: [width, height], format, usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST });
  gpu.queue.writeTexture({ texture }, Float32Array.from(data), { bytesPerRow: 4 * channels * width }, [width, height]);
  return texture;
}

/** A depth buffer with given contents, drawn as a renderer would. */
function depthBuffer(gpu: GPUDevice, data: readonly number[], width: number, height: number): GPUTexture {
  const source = upload(gpu, data, width, height, 1);
  const texture = gpu.createTexture({ size: [width, height], format: "depth32float", usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.RENDER_ATTACHMENT });
  const module = gpu.createShaderModule({
    code: `@group(0) @binding(0) var source: texture_2d<f32>;
      @vertex fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f { return vec4f(vec2f(f32(i & 1u), f32(i >> 1u)) * 4.0 - 1.0, 0.0, 1.0); }
      @fragment fn put(@builtin(position) at: vec4f) -> @builtin(frag_depth) f32 { return textureLoad(source, vec2i(at.xy), 0).x; }`,
  });
  const entry = { binding: 0, visibility: GPUShaderStage.FRAGMENT, texture: { sampleType: "unfilterable-float" as const } };
  const group = gpu.createBindGroupLayout({ entries: [entry] });
  const pipeline = gpu.createRenderPipeline({
    layout: gpu.createPipelineLayout({ bindGroupLayouts: [group] }),
    vertex: { module },
    fragment: { module, targets: [] },
    depthStencil: { format: "depth32float", depthWriteEnabled: true, depthCompare: "always" },
  });
  const encoder = gpu.createCommandEncoder();
  const pass = encoder.beginRenderPass({
    colorAttachments: [],
    depthStencilAttachment: { view: texture.createView(), depthClearValue: 0, depthLoadOp: "clear", depthStoreOp: "store" },
  });
  pass.setPipeline(pipeline);
  pass.setBindGroup(0, gpu.createBindGroup({ layout: group, entries: [{ binding: 0, resource: source.createView() }] }));
  pass.draw(3);
  pass.end();
  gpu.queue.submit([encoder.finish()]);
  return texture;
}

async function readPicture(gpu: GPUDevice, texture: GPUTexture): Promise<number[]> {
  const { width, height } = texture;
  const pitch = Math.ceil((16 * width) / 256) * 256;
  const copy = gpu.createBuffer({ size: pitch * height, usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ });
  const encoder = gpu.createCommandEncoder();
  encoder.copyTextureToBuffer({ texture }, { buffer: copy, bytesPerRow: pitch }, [width, height]);
  gpu.queue.submit([encoder.finish()]);
  await copy.mapAsync(GPUMapMode.READ);
  const rows = new Float32Array(copy.getMappedRange());
  const data: number[] = [];
  for (let y = 0; y < height; y++) data.push(...rows.subarray((y * pitch) / 4, (y * pitch) / 4 + 4 * width));
  copy.destroy();
  return data;
}

/** Lenses by what they are made of: to compile one takes longer than most of its frames. */
const lenses = new Map<string, Promise<Lens>>();

/** A lens for a request; one with changed shaders is made anew, and is the caller's to dispose of. */
async function lensFor(gpu: GPUDevice, request: LensRequest): Promise<{ lens: Lens; kept: boolean }> {
  const { width, height, libraries, options, hardware, plant, idle } = request;
  const make = async () => {
    const read = await Promise.all(libraries.map((text) => readLibrary(bytes(text))));
    return Lens.create(gpu, { ...options, libraries: read, format: "rgba32float" }, width, height);
  };
  if (plant || idle) return { lens: await make(), kept: false };
  const key = JSON.stringify([width, height, libraries, options, hardware]);
  // Only the last one: lenses of many sizes would fill the memory.
  if (!lenses.has(key)) {
    for (const other of lenses.values()) (await other.catch(() => null))?.dispose();
    lenses.clear();
    lenses.set(key, make());
  }
  return { lens: await lenses.get(key)!, kept: true };
}

async function draw(request: LensRequest): Promise<LensAnswer> {
  const { width, height } = request;
  const { device: gpu, adapter } = await device();
  const errors: string[] = [];
  const listen = (event: Event) => void errors.push((event as GPUUncapturedErrorEvent).error.message);
  gpu.addEventListener("uncapturederror", listen);
  const original = gpu.createShaderModule.bind(gpu);
  if (request.hardware) Object.defineProperty(gpu, "adapterInfo", { value: {}, configurable: true });
  else delete (gpu as { adapterInfo?: unknown }).adapterInfo;
  gpu.createShaderModule = (descriptor) => {
    const name = descriptor.label?.replace("lens: ", "") ?? "";
    if (request.idle?.includes(name)) return original({ ...descriptor, code: "@compute @workgroup_size(1) fn main() {}" });
    const { plant } = request;
    if (plant?.shader !== name) return original(descriptor);
    if (!descriptor.code.includes(plant.from)) throw new Error(`nothing to plant in ${name}`);
    return original({ ...descriptor, code: descriptor.code.replaceAll(plant.from, plant.to) });
  };
  try {
    const { lens, kept: keep } = await lensFor(gpu, request);
    const color = upload(gpu, request.light, width, height, 4);
    const depth = request.depthBuffer ? depthBuffer(gpu, request.depth, width, height) : upload(gpu, request.depth, width, height, 1);
    const motion = request.motion ? upload(gpu, request.motion, width, height, 2) : null;
    const picture = gpu.createTexture({ size: [width, height], format: "rgba32float", usage: GPUTextureUsage.STORAGE_BINDING | GPUTextureUsage.COPY_SRC });
    const milliseconds: number[] = [];
    for (let round = 0; round < (request.rounds ?? 1); round++) {
      const start = performance.now();
      const encoder = gpu.createCommandEncoder();
      lens.encode(encoder, { color, depth, depthMeaning: { kind: "linear" }, motion, camera: request.camera, ...request.frame, picture });
      gpu.queue.submit([encoder.finish()]);
      await gpu.queue.onSubmittedWorkDone();
      milliseconds.push(performance.now() - start);
    }
    const { guard, domain } = lens.planned!;
    const buffers: Record<string, number[]> = {};
    for (const name of request.read ?? []) buffers[name] = Array.from(new Int32Array(await lens.read(name)));
    const answer = { picture: await readPicture(gpu, picture), buffers, guard, domain, report: await lens.report(), errors, adapter, milliseconds };
    if (!keep) lens.dispose();
    for (const texture of [color, depth, motion, picture]) texture?.destroy();
    return answer;
  } finally {
    gpu.createShaderModule = original;
    gpu.removeEventListener("uncapturederror", listen);
  }
}

/** Buffers and textures that a lens makes and destroys, over two sizes of frames. */
async function leftovers(library: string): Promise<{ made: number; left: number; after: string }> {
  const { device: gpu } = await device();
  const alive = new Set<object>();
  let made = 0;
  const originals = { buffer: gpu.createBuffer.bind(gpu), texture: gpu.createTexture.bind(gpu) };
  const watch = <T extends { destroy(): undefined }>(one: T): T => {
    made++;
    alive.add(one);
    const destroy = one.destroy.bind(one);
    one.destroy = () => {
      alive.delete(one);
      return destroy();
    };
    return one;
  };
  gpu.createBuffer = (descriptor) => watch(originals.buffer(descriptor));
  gpu.createTexture = (descriptor) => watch(originals.texture(descriptor));
  const lens = new Lens(gpu, { libraries: [await readLibrary(bytes(library))], largest: 4, format: "rgba32float" });
  let frame: LensFrame | null = null;
  for (const size of [24, 32]) {
    const picture = originals.texture({ size: [size, size], format: "rgba32float", usage: GPUTextureUsage.STORAGE_BINDING });
    const color = originals.texture({ size: [size, size], format: "rgba32float", usage: GPUTextureUsage.TEXTURE_BINDING });
    const depth = originals.texture({ size: [size, size], format: "r32float", usage: GPUTextureUsage.TEXTURE_BINDING });
    frame = { color, depth, depthMeaning: { kind: "linear" }, picture };
    const encoder = gpu.createCommandEncoder();
    lens.encode(encoder, frame);
    gpu.queue.submit([encoder.finish()]);
  }
  await lens.report();
  lens.dispose();
  gpu.createBuffer = originals.buffer;
  gpu.createTexture = originals.texture;
  let after = "";
  try {
    lens.encode(gpu.createCommandEncoder(), frame!);
  } catch (error) {
    after = String(error);
  }
  return { made, left: alive.size, after };
}

declare global {
  interface Window {
    lensDraw(request: LensRequest): Promise<LensAnswer>;
    lensLeftovers(library: string): Promise<{ made: number; left: number; after: string }>;
    lensAdapter(): Promise<string | null>;
    lensReady: boolean;
  }
}

window.lensDraw = draw;
window.lensLeftovers = leftovers;
window.lensAdapter = async () => ((await navigator.gpu?.requestAdapter()) ? (await device()).adapter : null);
window.lensReady = true;
