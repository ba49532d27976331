/** WGSL that makes of a drawn frame what the lens reads: one depth a pixel, coverage as a picture, and whether anything is uncovered. */

/** Coverage below this is that of a pixel that the scene does not cover. */
const COVERED = 0.999;

const shader = (multisampled: boolean) => /* wgsl */ `
@group(0) @binding(0) var color: texture_2d<f32>;
@group(0) @binding(1) var depth: ${multisampled ? "texture_depth_multisampled_2d" : "texture_depth_2d"};
@group(0) @binding(2) var single: texture_storage_2d<r32float, write>;
@group(0) @binding(3) var coverage: texture_storage_2d<rgba16float, write>;
@group(0) @binding(4) var<storage, read_write> uncovered: atomic<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
  if (any(id.xy >= textureDimensions(color))) { return; }
  let alpha = textureLoad(color, id.xy, 0).w;
  // The first sample, as where a multisampled depth buffer of WebGL is resolved.
  textureStore(single, id.xy, vec4f(textureLoad(depth, id.xy, 0)));
  textureStore(coverage, id.xy, vec4f(alpha));
  if (alpha < ${COVERED}) { atomicStore(&uncovered, 1u); }
}
`;

/** Textures of one frame. */
export interface FrameTextures {
  readonly color: GPUTexture;
  readonly depth: GPUTexture;
  /** r32float, written. */
  readonly single: GPUTexture;
  /** rgba16float, written. */
  readonly coverage: GPUTexture;
}

const FLAG_BYTES = 4;

/** Owns the shader and the flag. */
export class LensInputs {
  private readonly device: GPUDevice;
  private readonly flag: GPUBuffer;
  private readonly copy: GPUBuffer;
  /** The flag that is on its way, of the last frame that was copied. */
  private coming: Promise<boolean> | null = null;
  private pipeline: GPUComputePipeline | null = null;
  private multisampled = false;

  constructor(device: GPUDevice) {
    this.device = device;
    this.flag = device.createBuffer({ size: FLAG_BYTES, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST | GPUBufferUsage.COPY_SRC });
    this.copy = device.createBuffer({ size: FLAG_BYTES, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
  }

  /** Add the work of a frame to an encoder. */
  encode(encoder: GPUCommandEncoder, { color, depth, single, coverage }: FrameTextures): void {
    const pipeline = this.pipelineFor(depth.sampleCount > 1);
    const resources = [color.createView(), depth.createView({ aspect: "depth-only" }), single.createView(), coverage.createView(), { buffer: this.flag }];
    encoder.clearBuffer(this.flag);
    const pass = encoder.beginComputePass({ label: "lens inputs" });
    pass.setPipeline(pipeline);
    pass.setBindGroup(0, this.device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries: resources.map((resource, binding) => ({ binding, resource })) }));
    pass.dispatchWorkgroups(Math.ceil(color.width / 8), Math.ceil(color.height / 8));
    pass.end();
    // A buffer that is being read takes no copy: a frame that does not wait for the one before has its flag.
    if (!this.coming) encoder.copyBufferToBuffer(this.flag, 0, this.copy, 0, FLAG_BYTES);
  }

  /** Whether the frame that was submitted has pixels that the scene does not cover. */
  uncovered(): Promise<boolean> {
    this.coming ??= this.read().finally(() => {
      this.coming = null;
    });
    return this.coming;
  }

  dispose(): void {
    this.flag.destroy();
    this.copy.destroy();
  }

  private async read(): Promise<boolean> {
    await this.copy.mapAsync(GPUMapMode.READ);
    const [found] = new Uint32Array(this.copy.getMappedRange());
    this.copy.unmap();
    return found === 1;
  }

  private pipelineFor(multisampled: boolean): GPUComputePipeline {
    if (this.pipeline && multisampled === this.multisampled) return this.pipeline;
    this.multisampled = multisampled;
    const module = this.device.createShaderModule({ label: "lens inputs", code: shader(multisampled) });
    this.pipeline = this.device.createComputePipeline({ label: "lens inputs", layout: "auto", compute: { module, entryPoint: "main" } });
    return this.pipeline;
  }
}
