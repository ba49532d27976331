/** Blurs the picture through the lens: colour and depth go from WebGL to a WebGPU device, and the blurred picture comes back. */

import { DEFAULT_CAMERA, Lens, type LensCamera, readLibrary } from "lightwell/lens";
import {
  BufferGeometry,
  DataTexture,
  DepthTexture,
  Float32BufferAttribute,
  FloatType,
  HalfFloatType,
  LinearFilter,
  Mesh,
  NoBlending,
  OrthographicCamera,
  type PerspectiveCamera,
  RGBAFormat,
  type Scene,
  ShaderMaterial,
  type Texture,
  type WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import disc from "../../../lightwell/lens/standard/disc-32.lwsp?inline";

/** Rows of a texture that is copied to a buffer begin at multiples of this (WebGPU). */
const ROW = 256;
/** Half-float one, and what counts as covered: alpha is never negative, so that its bits are in the order of its values. */
const ALMOST_ONE = 0x3bfe;

/** What lies on the device for one size: a coverage has its own colour and picture. */
type Textures = Record<"color" | "picture" | "coverColor" | "coverPicture" | "depth", GPUTexture>;

/** What the user sets. */
export type LensSetting = Pick<LensCamera, "focus" | "fstop">;

/** Focal length of a full-frame camera with this field of view, metres. */
export function focalLength(camera: PerspectiveCamera): number {
  return DEFAULT_CAMERA.sensor / 2 / (Math.tan((camera.fov * Math.PI) / 360) * camera.aspect);
}

/** Owns the device, the lens on it, and the blurred picture. Rows are bottom-up throughout, as WebGL has them. */
export class LensPass {
  private readonly device: GPUDevice;
  private readonly lens: Lens;
  private readonly camera = new OrthographicCamera();
  private readonly depthOut = new WebGLRenderTarget(1, 1, { type: FloatType, depthBuffer: false });
  private readonly screen: Mesh<BufferGeometry, ShaderMaterial>;
  private textures: Textures | null = null;
  private picture: DataTexture | null = null;

  private constructor(device: GPUDevice, lens: Lens) {
    [this.device, this.lens] = [device, lens];
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new Float32BufferAttribute([-1, -1, 0, 3, -1, 0, -1, 3, 0], 3));
    const material = new ShaderMaterial({
      name: "depth",
      uniforms: { depth: { value: null as Texture | null } },
      vertexShader: "void main() { gl_Position = vec4( position.xy, 0.0, 1.0 ); }",
      fragmentShader:
        "precision highp sampler2D; uniform sampler2D depth; void main() { gl_FragColor = vec4( texelFetch( depth, ivec2( gl_FragCoord.xy ), 0 ).r ); }",
      depthTest: false,
      depthWrite: false,
      blending: NoBlending,
    });
    this.screen = new Mesh(geometry, material);
    this.screen.frustumCulled = false;
  }

  /** The pass, or why there is none. */
  static async open(): Promise<LensPass> {
    const adapter = await navigator.gpu?.requestAdapter();
    if (!adapter) throw new Error("The lens needs WebGPU, which this browser does not offer here.");
    const { maxStorageBufferBindingSize, maxBufferSize, maxComputeWorkgroupStorageSize } = adapter.limits;
    const requiredLimits = { maxStorageBufferBindingSize, maxBufferSize, maxComputeWorkgroupStorageSize };
    const device = await adapter.requestDevice({ requiredLimits });
    const library = await readLibrary(await (await fetch(disc)).arrayBuffer());
    return new LensPass(device, new Lens(device, { libraries: [library] }));
  }

  /** Resolves when the device is gone, with what the browser says of it; never while it is there, or after `dispose`. */
  get lost(): Promise<string> {
    return this.device.lost.then(({ reason, message }) => (reason === "destroyed" ? new Promise<never>(() => {}) : message));
  }

  /** Give a target a depth texture, which the lens reads. */
  static prepare(target: WebGLRenderTarget): void {
    if (target.depthTexture) return;
    target.dispose();
    target.depthTexture = new DepthTexture(target.width, target.height, FloatType);
  }

  /** The picture of a target through the lens, as linear radiance of the same size; valid until the next one. */
  async blur(renderer: WebGLRenderer, target: WebGLRenderTarget, camera: PerspectiveCamera, setting: LensSetting): Promise<Texture> {
    const { width, height } = target;
    const color = new Uint16Array(4 * width * height);
    renderer.readRenderTargetPixels(target, 0, 0, width, height, color);
    const depth = this.readDepth(renderer, target);
    const textures = this.fit(width, height);
    const { queue } = this.device;
    queue.writeTexture({ texture: textures.color }, color, { bytesPerRow: 8 * width }, [width, height]);
    queue.writeTexture({ texture: textures.depth }, depth, { bytesPerRow: 4 * width }, [width, height]);
    const encoder = this.device.createCommandEncoder();
    const frame = {
      depth: textures.depth,
      depthMeaning: { kind: "projection", matrix: camera.projectionMatrix.elements, range: "webgl" },
      camera: { ...setting, focal: focalLength(camera) },
    } as const;
    this.lens.encode(encoder, { ...frame, color: textures.color, picture: textures.picture });
    // What nothing covers is black and far away, so that light is divided by the weight of all pixels; coverage is blurred by itself.
    const coverage = coverageOf(color);
    if (coverage) {
      queue.writeTexture({ texture: textures.coverColor }, coverage, { bytesPerRow: 8 * width }, [width, height]);
      this.lens.encode(encoder, { ...frame, color: textures.coverColor, picture: textures.coverPicture });
    }
    queue.submit([encoder.finish()]);
    color.set(await this.fetch(textures.picture));
    if (coverage) {
      const covered = await this.fetch(textures.coverPicture);
      for (let i = 3; i < color.length; i += 4) color[i] = covered[i - 3]!;
    }
    return this.hang(color, width, height);
  }

  dispose(): void {
    this.lens.dispose();
    for (const texture of Object.values(this.textures ?? {})) texture.destroy();
    this.device.destroy();
    this.picture?.dispose();
    this.depthOut.dispose();
    this.screen.geometry.dispose();
    this.screen.material.dispose();
  }

  private readDepth(renderer: WebGLRenderer, target: WebGLRenderTarget): Float32Array<ArrayBuffer> {
    const { width, height } = target;
    this.depthOut.setSize(width, height);
    this.screen.material.uniforms.depth!.value = target.depthTexture;
    renderer.setRenderTarget(this.depthOut);
    renderer.render(this.screen as unknown as Scene, this.camera);
    renderer.setRenderTarget(null);
    const rgba = new Float32Array(4 * width * height);
    renderer.readRenderTargetPixels(this.depthOut, 0, 0, width, height, rgba);
    return Float32Array.from({ length: width * height }, (_, i) => rgba[4 * i]!);
  }

  /** The half floats of a picture on the device, once it is done. */
  private async fetch(texture: GPUTexture): Promise<Uint16Array> {
    const { width, height } = texture;
    const pitch = Math.ceil((8 * width) / ROW) * ROW;
    const copy = this.device.createBuffer({ size: pitch * height, usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ });
    const encoder = this.device.createCommandEncoder();
    encoder.copyTextureToBuffer({ texture }, { buffer: copy, bytesPerRow: pitch }, [width, height]);
    this.device.queue.submit([encoder.finish()]);
    await copy.mapAsync(GPUMapMode.READ);
    const rows = new Uint16Array(copy.getMappedRange());
    const data = new Uint16Array(4 * width * height);
    for (let y = 0; y < height; y++) data.set(rows.subarray((y * pitch) / 2, (y * pitch) / 2 + 4 * width), 4 * width * y);
    copy.destroy();
    return data;
  }

  private fit(width: number, height: number): Textures {
    if (this.textures?.color.width === width && this.textures.color.height === height) return this.textures;
    for (const texture of Object.values(this.textures ?? {})) texture.destroy();
    const make = (format: GPUTextureFormat, usage: number) => this.device.createTexture({ size: [width, height], format, usage });
    const input = GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST;
    const output = GPUTextureUsage.STORAGE_BINDING | GPUTextureUsage.COPY_SRC;
    this.textures = {
      color: make("rgba16float", input),
      picture: make("rgba16float", output),
      coverColor: make("rgba16float", input),
      coverPicture: make("rgba16float", output),
      depth: make("r32float", input),
    };
    return this.textures;
  }

  private hang(data: Uint16Array<ArrayBuffer>, width: number, height: number): DataTexture {
    if (this.picture?.image.width !== width || this.picture.image.height !== height) {
      this.picture?.dispose();
      this.picture = new DataTexture(data, width, height, RGBAFormat, HalfFloatType);
      this.picture.minFilter = this.picture.magFilter = LinearFilter;
    }
    this.picture.image.data = data;
    this.picture.needsUpdate = true;
    return this.picture;
  }
}

/** Coverage as a picture of its own, half floats; null where everything is covered. */
function coverageOf(color: Uint16Array): Uint16Array<ArrayBuffer> | null {
  let whole = true;
  for (let i = 3; whole && i < color.length; i += 4) whole = color[i]! >= ALMOST_ONE;
  return whole ? null : Uint16Array.from(color, (_, i) => color[i | 3]!);
}
