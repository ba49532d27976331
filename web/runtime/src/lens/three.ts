/** `lightwell/lens/three`: the lens as a node of three.js' `RenderPipeline`, after a `pass` of a `WebGPURenderer`. */

import { HalfFloatType, LinearSRGBColorSpace, type OrthographicCamera, PerspectiveCamera, type Texture } from "three";
import { texture } from "three/tsl";
import { Node, NodeUpdateType, StorageTexture } from "three/webgpu";
import type { AnyNode } from "../webgpu/field-nodes.ts";
import type { DepthMeaning, LensCamera } from "./camera.ts";
import type { Edges } from "./frame-block.ts";
import { Lens } from "./lens.ts";
import type { SpreadletLibrary } from "./library.ts";

/** Options of a `LensNode`. */
export interface LensNodeOptions {
  readonly libraries: readonly SpreadletLibrary[];
  readonly layers?: number;
  readonly largest?: number;
  readonly longest?: number;
  readonly edges?: Edges;
  /** A texture node with the velocity of `three/tsl` (`mrt({ output, velocity })`), for motion blur. */
  readonly velocity?: AnyNode;
}

/** Millimetres of a metre: three.js counts film in millimetres. */
const MILLI = 1e-3;

/**
 * Depth of field and motion blur of a pass. Focal length and sensor are those of the camera (`setFocalLength`, `filmGauge`)
 * unless `lens` says otherwise; change `lens` at any time. Draw the pass without multisampling.
 *
 *     const scenePass = pass(scene, camera, { samples: 0 });
 *     const lens = new LensNode(scenePass, { libraries: [await readLibrary(bytes)] });
 *     pipeline.outputNode = lens;
 *     lens.lens.focus = 3;
 */
export class LensNode extends Node {
  /** Of the lens: metres, see `LensCamera`. */
  readonly lens: { -readonly [K in keyof LensCamera]?: LensCamera[K] } = {};
  /** Whether anything is blurred. */
  enabled = true;
  /** Scene-referred value that shows as white. */
  white = 1;
  /** Circle of confusion where two layers part, px; cuts are found by themselves when null. */
  cut: number | null = null;
  private readonly scenePass: AnyNode;
  private readonly options: LensNodeOptions;
  private readonly picture = new StorageTexture(1, 1);
  private readonly output: AnyNode;
  private readonly sharp: AnyNode;
  private effect: Lens | null = null;
  private frames = 0;

  constructor(scenePass: AnyNode, options: LensNodeOptions) {
    super("vec4");
    [this.scenePass, this.options] = [scenePass, options];
    this.updateBeforeType = NodeUpdateType.FRAME;
    this.picture.type = HalfFloatType;
    this.picture.colorSpace = LinearSRGBColorSpace;
    this.picture.generateMipmaps = false;
    this.sharp = scenePass.getTextureNode();
    this.output = texture(this.picture);
  }

  /** What the last frame took; null before one. */
  get effectOnDevice(): Lens | null {
    return this.effect;
  }

  override setup(builder: AnyNode): AnyNode {
    // The pass comes first: what this node depends on is drawn before it.
    const properties = builder.getNodeProperties(this);
    properties.textureNode = this.sharp;
    if (this.options.velocity) properties.velocityNode = this.options.velocity;
    return this.output;
  }

  override updateBefore({ renderer }: AnyNode): boolean | undefined {
    const { backend } = renderer;
    if (!backend.isWebGPUBackend) throw new Error("lens: this renderer fell back to WebGL 2; the lens needs WebGPU");
    const on = (one: Texture): GPUTexture => backend.get(one).texture;
    const device = backend.device as GPUDevice;
    const color = on(this.scenePass.getTexture("output"));
    const depth = on(this.scenePass.getTexture("depth"));
    const { width, height } = this.picture.image as { width: number; height: number };
    if (width !== color.width || height !== color.height) (this.picture as AnyNode).setSize(color.width, color.height);
    renderer.initTexture(this.picture);
    const encoder = device.createCommandEncoder({ label: "lens" });
    if (this.enabled) {
      this.effect ??= new Lens(device, { ...this.options, format: "rgba16float" });
      const velocity = this.options.velocity ? on(this.options.velocity.value) : null;
      this.effect.encode(encoder, {
        color,
        depth,
        depthMeaning: depthOf(this.scenePass.camera),
        motion: velocity,
        // Velocity is in normalised device coordinates, y up.
        motionScale: [color.width / 2, -color.height / 2],
        camera: { ...opticsOf(this.scenePass.camera), ...this.lens },
        white: this.white,
        cut: this.cut,
        number: this.frames++,
        picture: on(this.picture),
      });
    } else {
      encoder.copyTextureToTexture({ texture: color }, { texture: on(this.picture) }, [color.width, color.height]);
    }
    device.queue.submit([encoder.finish()]);
    return undefined;
  }

  override dispose(): void {
    this.effect?.dispose();
    this.effect = null;
    this.picture.dispose();
    super.dispose();
  }
}

/** What a camera's depth buffer holds, on WebGPU. */
export function depthOf(camera: PerspectiveCamera | OrthographicCamera): DepthMeaning {
  return { kind: "projection", matrix: camera.projectionMatrix.elements, range: "webgpu" };
}

/** Focal length and sensor of a perspective camera, metres: its zoom is that of the lens. */
export function opticsOf(camera: PerspectiveCamera | OrthographicCamera): { focal?: number; sensor?: number } {
  if (!(camera instanceof PerspectiveCamera)) return {};
  const focal = camera.getFocalLength() * camera.zoom * MILLI;
  return { focal, sensor: camera.getFilmWidth() * MILLI };
}
