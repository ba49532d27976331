/** The path-traced pictures of the saved views, and how far the learned picture is from them. */

import { type DataTexture, DataUtils, type WebGLRenderer } from "three";
import type { CameraRig } from "./camera-rig.ts";
import { type Comparison, compare, FLOOR_SHARE, meanRadiance } from "./comparison.ts";
import type { Mode } from "./modes.ts";
import { SHOW } from "./output-shader.ts";
import type { ViewData } from "./page-data.ts";
import type { Pipeline } from "./pipeline.ts";
import { decodeReference } from "./reference.ts";
import type { Stage } from "./stage.ts";

/** Exposed luminance that half of a picture may exceed before it looks washed out, and the side of a metered block. */
const CALM_LUMINANCE = 0.45;
const BLOCK = 8;

/** What is compared with what. */
export interface Compared {
  readonly index: number;
  readonly view: ViewData;
  readonly mode: Mode;
  readonly stage: Stage;
  readonly rig: CameraRig;
}

/** Decodes each picture once, and owns the textures. */
export class ReferencePictures {
  comparison: Comparison | null = null;
  private readonly renderer: WebGLRenderer;
  private readonly pipeline: Pipeline;
  private readonly decoding = new Map<number, Promise<DataTexture>>();
  private readonly decoded = new Map<number, DataTexture>();

  constructor(renderer: WebGLRenderer, pipeline: Pipeline) {
    this.renderer = renderer;
    this.pipeline = pipeline;
  }

  /** The picture of a view; `tell` hears once, when it is there or cannot be. */
  picture(index: number, view: ViewData, tell: (error: Error | null) => void): Promise<DataTexture> {
    let work = this.decoding.get(index);
    if (!work) {
      work = decodeReference(view);
      this.decoding.set(index, work);
      work.then((texture) => {
        this.decoded.set(index, texture);
        tell(null);
      }, tell);
    }
    return work;
  }

  /** Whether the picture of a view is decoded. */
  has(index: number | null): index is number {
    return index !== null && this.decoded.has(index);
  }

  /** Set up reference and difference for the next presentation; returns whether `comparison` is new. */
  draw({ index, view, mode, stage, rig }: Compared): boolean {
    const { uniforms } = this.pipeline;
    const reference = this.decoded.get(index)!;
    const truth = reference.image.data as unknown as Uint16Array;
    uniforms.reference.value = reference;
    uniforms.show.value = SHOW[mode as keyof typeof SHOW];
    uniforms.frame.value.set(...rig.frame());
    if (this.comparison !== null && mode !== "difference") return false;
    const { width, height } = view;
    uniforms.floorRadiance.value = FLOOR_SHARE * meanRadiance(truth);
    this.pipeline.renderStage(this.pipeline.picture, width, height, stage, rig.frameCamera());
    if (this.comparison !== null) return false;
    const pixels = new Uint16Array(width * height * 4);
    this.renderer.readRenderTargetPixels(this.pipeline.picture, 0, 0, width, height, pixels);
    this.comparison = compare(pixels, truth, width, height);
    return true;
  }

  clear(): void {
    for (const texture of this.decoded.values()) texture.dispose();
    this.decoding.clear();
    this.decoded.clear();
    this.comparison = null;
  }
}

/** Largest exposure at which a picture is not washed out; means over blocks keep the path tracer's noise out of it. */
export function calmExposure(picture: DataTexture): number {
  const { width, height } = picture.image;
  const data = picture.image.data as unknown as Uint16Array;
  const columns = Math.ceil(width / BLOCK);
  const sums = new Float64Array(columns * Math.ceil(height / BLOCK));
  const counts = new Uint32Array(sums.length);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const [i, block] = [4 * (y * width + x), Math.floor(y / BLOCK) * columns + Math.floor(x / BLOCK)];
      const [r, g, b] = [data[i]!, data[i + 1]!, data[i + 2]!].map(DataUtils.fromHalfFloat);
      sums[block]! += 0.2126 * r! + 0.7152 * g! + 0.0722 * b!;
      counts[block]!++;
    }
  }
  const means = sums.map((sum, i) => sum / counts[i]!).sort();
  return CALM_LUMINANCE / Math.max(means[means.length >> 1]!, 1e-9);
}
