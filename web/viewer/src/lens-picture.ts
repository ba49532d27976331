/**
 * The page's picture through the lens. three.js' renderer for WebGPU draws the scene, the lens reads the textures that it drew into, and the
 * blurred picture is shown on a canvas above the page's own: on one device, so that no pixel is read back.
 */

import type { LearnedScene } from "lightwell";
import { DEFAULT_CAMERA, Lens, readLibrary } from "lightwell/lens";
import {
  DepthTexture,
  FloatType,
  HalfFloatType,
  LinearSRGBColorSpace,
  NoColorSpace,
  PCFShadowMap,
  PerspectiveCamera,
  RedFormat,
  RenderTarget,
  type Texture,
  WebGPUCoordinateSystem,
} from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import { QuadMesh, StorageTexture } from "three/webgpu";
import disc from "../../../lightwell/lens/standard/disc-32.lwsp?inline";
import { DeviceRenderer } from "./device-renderer.ts";
import { LensInputs } from "./lens-inputs.ts";
import { LensOutput } from "./lens-output.ts";
import { LensStage, type LensView } from "./lens-stage.ts";
import type { ToneMappingName } from "./tone-mapping.ts";

/** What is asked of a device beyond what every one has, where there is more. */
const FEATURES = ["core-features-and-limits", "float32-filterable"];
const LIMITS = [
  "maxStorageBufferBindingSize",
  "maxBufferSize",
  "maxComputeWorkgroupStorageSize",
  "maxSampledTexturesPerShaderStage",
  "maxSamplersPerShaderStage",
  "maxUniformBufferBindingSize",
  "maxTextureDimension2D",
] as const;

/** What a frame is drawn with. */
export interface LensFrame extends LensView {
  /** What is to the left of `split` (0 to 1); null for nothing. */
  readonly beside: LensView | null;
  readonly split: number;
  /** The scene of the page, which is followed. */
  readonly page: LearnedScene;
  readonly camera: PerspectiveCamera;
  readonly toneMapping: ToneMappingName;
  /** Distance in focus, metres, and f-number. */
  readonly setting: { readonly focus: number; readonly fstop: number };
}

/** How frames are drawn for as long as the page is there. */
export interface PictureOptions {
  /** Samples a pixel. */
  readonly samples: number;
  readonly dither: boolean;
}

/** Focal length of a full-frame camera with this field of view, metres. */
export function focalLength(camera: PerspectiveCamera): number {
  return DEFAULT_CAMERA.sensor / 2 / (Math.tan((camera.fov * Math.PI) / 360) * camera.aspect);
}

/** Owns device, renderer, canvas, lens and what lies between them. */
export class LensPicture {
  readonly canvas: HTMLCanvasElement;
  private readonly device: GPUDevice;
  private readonly renderer: DeviceRenderer;
  private readonly lens: Lens;
  private readonly inputs: LensInputs;
  private readonly camera = new PerspectiveCamera();
  private readonly target: RenderTarget;
  /** One depth a pixel; coverage; both through the lens and not. */
  private readonly depth = storage(FloatType);
  private readonly coverage = storage(HalfFloatType);
  private readonly picture = storage(HalfFloatType);
  private readonly coverPicture = storage(HalfFloatType);
  private readonly besidePicture = storage(HalfFloatType);
  private readonly output: LensOutput;
  private readonly quad: QuadMesh;
  private stage: LensStage | null = null;
  /** Whether the scene leaves pixels uncovered, as far as is known: then coverage goes through the lens too. */
  private open = true;

  private constructor(device: GPUDevice, renderer: DeviceRenderer, lens: Lens, { samples, dither }: PictureOptions) {
    [this.device, this.renderer, this.lens] = [device, renderer, lens];
    this.canvas = renderer.domElement;
    this.inputs = new LensInputs(device);
    this.target = new RenderTarget(1, 1, { type: HalfFloatType, samples, depthTexture: new DepthTexture(1, 1, FloatType) });
    this.output = new LensOutput({ picture: this.picture, beside: this.besidePicture, coverage: this.coverPicture }, dither);
    this.quad = new QuadMesh(this.output.material);
  }

  /** Rejects with a message where the browser offers no WebGPU. `above`: the page's own canvas. */
  static async open(above: HTMLCanvasElement, options: PictureOptions): Promise<LensPicture> {
    const adapter = await navigator.gpu?.requestAdapter();
    if (!adapter) throw new Error("The lens needs WebGPU, which this browser does not offer here.");
    const requiredLimits = Object.fromEntries(LIMITS.map((name) => [name, adapter.limits[name]]));
    const requiredFeatures = FEATURES.filter((name) => adapter.features.has(name)) as GPUFeatureName[];
    const device = await adapter.requestDevice({ requiredLimits, requiredFeatures });
    const library = await readLibrary(await (await fetch(disc)).arrayBuffer());
    const canvas = document.createElement("canvas");
    canvas.className = "lens";
    canvas.hidden = true;
    canvas.style.cssText = above.style.cssText;
    // The canvas below has the name.
    canvas.setAttribute("aria-hidden", "true");
    const renderer = new DeviceRenderer({ canvas, device, antialias: false });
    // Who owns the picture is told by `lost`.
    renderer.onDeviceLost = () => {};
    await renderer.init();
    renderer.setPixelRatio(1);
    renderer.setClearColor(0, 0);
    renderer.outputColorSpace = LinearSRGBColorSpace;
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = PCFShadowMap;
    const lens = await Lens.create(device, { libraries: [library] }, above.width, above.height);
    above.after(canvas);
    return new LensPicture(device, renderer, lens, options);
  }

  /** Resolves when the device is gone, with what the browser says of it; never while it is there, or after `dispose`. */
  get lost(): Promise<string> {
    return this.device.lost.then(({ reason, message }) => (reason === "destroyed" ? new Promise<never>(() => {}) : message));
  }

  /** Take a file in the place of the last one. */
  put(gltf: GLTF): void {
    this.clear();
    this.stage = new LensStage(gltf, this.renderer);
    this.open = !this.stage.hasSky;
  }

  /** Forget the file. */
  clear(): void {
    this.stage?.dispose();
    this.stage = null;
  }

  /** Take over what the page shows; returns whether `compile` is due before the next frame. */
  follow(page: LearnedScene): boolean {
    return this.stage?.follow(page) ?? false;
  }

  /** Compile the shaders of the scene without holding up the page. */
  async compile(frame: LensFrame): Promise<void> {
    this.stage?.follow(frame.page);
    await this.stage?.compile(this.target, this.look(frame.camera), frame);
  }

  /** Draw a frame of this size onto the canvas; resolves when it is there, with whether it should be drawn once more. */
  draw(frame: LensFrame, width: number, height: number): Promise<boolean> {
    const { renderer } = this;
    this.fit(width, height);
    const camera = this.look(frame.camera);
    const { open } = this;
    // Both views have the same depth and coverage.
    if (frame.beside) this.blur(frame, frame.beside, camera, this.besidePicture, false);
    this.blur(frame, frame, camera, this.picture, open);
    this.output.set(frame.exposure, frame.beside ? frame.split : 0, frame.toneMapping);
    this.quad.render(renderer);
    renderer.endFrame();
    return this.finish(open);
  }

  dispose(): void {
    this.clear();
    this.lens.dispose();
    this.inputs.dispose();
    this.output.dispose();
    this.target.dispose();
    for (const texture of this.written) texture.dispose();
    this.renderer.dispose();
    this.device.destroy();
    this.canvas.remove();
  }

  /** Draw a view and blur it into a picture, with its coverage where that is `open`. */
  private blur({ setting }: LensFrame, view: LensView, camera: PerspectiveCamera, picture: Texture, open: boolean): void {
    const { device, target, lens } = this;
    this.stage!.render(target, camera, view);
    const encoder = device.createCommandEncoder({ label: "lens" });
    const [color, depth, coverage, coverPicture] = [target.texture, this.depth, this.coverage, this.coverPicture].map((one) => this.on(one));
    this.inputs.encode(encoder, { color: color!, depth: this.on(target.depthTexture!), single: depth!, coverage: coverage! });
    const optics = {
      depth: depth!,
      depthMeaning: { kind: "projection", matrix: camera.projectionMatrix.elements, range: "webgpu" },
      camera: { ...setting, focal: focalLength(camera) },
    } as const;
    lens.encode(encoder, { ...optics, color: color!, picture: this.on(picture) });
    // What nothing covers is black and far away, so that light is divided by the weight of all pixels; coverage is blurred by itself.
    if (open) lens.encode(encoder, { ...optics, color: coverage!, picture: coverPicture! });
    else encoder.copyTextureToTexture({ texture: coverage! }, { texture: coverPicture! }, [target.width, target.height]);
    device.queue.submit([encoder.finish()]);
  }

  /** Wait for the frame that was submitted. */
  private async finish(open: boolean): Promise<boolean> {
    const [found] = await Promise.all([this.inputs.uncovered(), this.device.queue.onSubmittedWorkDone()]);
    this.open = found;
    return found && !open;
  }

  private fit(width: number, height: number): void {
    const { renderer, target } = this;
    if (this.canvas.width !== width || this.canvas.height !== height) renderer.setSize(width, height, false);
    target.setSize(width, height);
    for (const texture of this.written) {
      const { image } = texture as unknown as { image: { width: number; height: number } };
      if (image.width !== width || image.height !== height) texture.setSize(width, height, 1);
      renderer.initTexture(texture);
    }
  }

  /** Textures that shaders write. */
  private get written(): readonly StorageTexture[] {
    return [this.depth, this.coverage, this.picture, this.coverPicture, this.besidePicture];
  }

  /** The camera of the page, with the depth of WebGPU. */
  private look(camera: PerspectiveCamera): PerspectiveCamera {
    this.camera.copy(camera);
    this.camera.coordinateSystem = WebGPUCoordinateSystem;
    this.camera.updateProjectionMatrix();
    return this.camera;
  }

  /** What a texture is on the device. */
  private on(texture: Texture): GPUTexture {
    return (this.renderer.backend as unknown as { get(of: Texture): { texture: GPUTexture } }).get(texture).texture;
  }
}

/** A texture that shaders write, of the size of a frame once there is one. */
function storage(type: typeof FloatType | typeof HalfFloatType): StorageTexture {
  const texture = new StorageTexture(1, 1);
  texture.type = type;
  texture.colorSpace = NoColorSpace;
  texture.generateMipmaps = false;
  if (type === FloatType) texture.format = RedFormat;
  return texture;
}
