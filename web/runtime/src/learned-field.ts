/** A learned field as it is while a scene is drawn, whatever the language of its shader: its lights, their gains, its textures. */

import {
  type CompressedTexture,
  DataTexture,
  FloatType,
  HalfFloatType,
  LinearFilter,
  LinearMipmapLinearFilter,
  NearestFilter,
  RGBAFormat,
  type Texture,
  Vector3,
} from "three";
import type { FieldRecord } from "./extension.ts";
import { evaluateFrame, frameLayout } from "./graph/frame.ts";
import type { Graph } from "./graph/node.ts";
import { only } from "./graph/part.ts";
import type { StoredBuffer } from "./graph/stored.ts";
import { MAX_LAMPS } from "./most.ts";

/** Where a field's weights live in the shader. */
export type WeightPlacement = "inline" | "texture";

/**
 * Some outputs of a field, evaluated for any number of lamps. What shaders read are the same objects whatever that number is, so
 * that programs compiled for different numbers can share them; an adapter prints the text.
 */
export abstract class LearnedField {
  readonly record: FieldRecord;
  /** The part of the record's graph that the outputs need. */
  readonly graph: Graph;
  /** Name of the function and prefix of everything else. */
  readonly name: string;
  readonly placement: WeightPlacement;
  /** Vectors of per-frame values for one lamp. */
  readonly blocks: number;
  /** Per-frame values of every lamp that there may be, lamp after lamp. */
  protected readonly frameValues: Float32Array<ArrayBuffer>;
  /** What the textures that the text reads hold, by the names that it gives to them. */
  protected readonly textures = new Map<string, Texture>();
  protected frameTexture: DataTexture | null = null;
  protected readonly lightSlots = slots();
  protected readonly gainSlots = slots();
  /** Values of the declared light that the field is evaluated for; shared with the lamps. */
  private lights: readonly Vector3[] = [];
  /** What the scene's own lamps are multiplied by, as the per-frame values have it; empty where the field has none. */
  private readonly dimmed: Float32Array;
  /** Poses of the nodes that move, as the per-frame values have them; empty where the field has none. */
  private readonly posed: Float32Array;
  /** The lights that the per-frame values belong to. */
  private readonly evaluated = slots(Number.NaN);

  constructor(record: FieldRecord, name: string, outputs: readonly string[], placement: WeightPlacement) {
    this.record = record;
    this.graph = only(record.graph, ...outputs);
    this.name = name;
    this.placement = placement;
    this.blocks = frameLayout(this.graph).blocks;
    this.dimmed = new Float32Array(this.graph.inputs.get("lamps") ?? 0).fill(Number.NaN);
    this.posed = new Float32Array(this.graph.inputs.get("pose") ?? 0).fill(Number.NaN);
    this.frameValues = new Float32Array(4 * this.blocks * MAX_LAMPS);
  }

  /** How many lamps the field is evaluated for. */
  get lamps(): number {
    return Math.max(this.lights.length, 1);
  }

  /** Multiply-adds per pixel, for all lamps. */
  get macs(): number {
    return this.graph.macs * this.lamps;
  }

  /** Bytes of the stored buffers. */
  get bytes(): number {
    return this.sum(({ picture, data }) => picture?.bytes ?? data.byteLength);
  }

  /** Bytes of them in the memory of the GPU, where a picture has four a texel. */
  get memory(): number {
    return this.sum(({ picture, shape, data }) =>
      picture ? 4 * shape[0]! * shape[1]! * (picture.mips > 0 ? 4 / 3 : 1) : data.byteLength,
    );
  }

  /** Follow these lights (at least one); after a change of their number the shaders must be compiled anew. */
  follow(lights: readonly Vector3[]): void {
    this.lights = lights;
    for (const evaluated of this.evaluated) evaluated.setScalar(Number.NaN);
  }

  /** Set what the value for a lamp is multiplied by: colour times intensity, or 0 where it is off. */
  setGain(lamp: number, gain: Vector3): void {
    this.gainSlots[lamp]!.copy(gain);
  }

  /**
   * Evaluate the per-frame part of each light that has moved, and of all where a lamp of the scene was dimmed; call before drawing.
   * `dimmers`: what the scene's own lamps are multiplied by; `poses`: of the nodes that move, 0 to 1.
   */
  update(dimmers: ArrayLike<number> = [], poses: ArrayLike<number> = []): void {
    if (this.posed.some((x, i) => x !== Math.fround(poses[i] ?? 0))) {
      this.posed.set(Array.from(this.posed, (_, i) => poses[i] ?? 0));
      for (const evaluated of this.evaluated) evaluated.setScalar(Number.NaN);
    }
    if (this.dimmed.some((x, i) => x !== dimmers[i])) {
      this.dimmed.set(dimmers);
      for (const evaluated of this.evaluated) evaluated.setScalar(Number.NaN);
    }
    this.lights.forEach((light, lamp) => {
      this.lightSlots[lamp]!.copy(light);
      if (this.blocks === 0 || this.evaluated[lamp]!.equals(light)) return;
      this.evaluated[lamp]!.copy(light);
      const size = 4 * this.blocks;
      evaluateFrame(this.graph, { light: light.toArray(), lamps: this.dimmed, pose: this.posed }, this.frameValues.subarray(size * lamp, size * (lamp + 1)));
      if (this.frameTexture) this.frameTexture.needsUpdate = true;
    });
  }

  dispose(): void {
    for (const texture of this.textures.values()) texture.dispose();
  }

  /** The texture of this name, made when it is first asked for. */
  protected keep(name: string, make: () => Texture): Texture {
    const found = this.textures.get(name) ?? make();
    this.textures.set(name, found);
    return found;
  }

  /** The texture of the per-frame values, a row a lamp. */
  protected keepFrame(name: string): Texture {
    this.frameTexture ??= texelTexture(this.frameValues, this.blocks, MAX_LAMPS);
    return this.keep(name, () => this.frameTexture!);
  }

  private sum(bytesOf: (buffer: StoredBuffer) => number): number {
    return Math.round([...this.record.buffers.values()].reduce((sum, buffer) => sum + bytesOf(buffer), 0));
  }
}

/** A texture of numbers, four a texel: halves as bits, or floats. */
export function texelTexture(data: Uint16Array<ArrayBuffer> | Float32Array<ArrayBuffer>, width: number, height: number): DataTexture {
  const texture = new DataTexture(data, width, height, RGBAFormat, data instanceof Uint16Array ? HalfFloatType : FloatType);
  texture.minFilter = texture.magFilter = NearestFilter;
  texture.needsUpdate = true;
  return texture;
}

/** The texture of a buffer that is a picture, set up to be sampled as far down its mipmaps as it may be. */
export function pictureTexture(buffer: StoredBuffer): Texture {
  const texture = buffer.picture!.source as Texture;
  const { mips } = buffer.picture!;
  const compressed = (texture as CompressedTexture).isCompressedTexture === true;
  // A GPU makes no mipmaps of blocks: those that may be read are in the file.
  if (compressed) texture.mipmaps = texture.mipmaps!.slice(0, 1 + mips);
  const minified = compressed ? texture.mipmaps!.length > 1 : mips > 0;
  texture.magFilter = LinearFilter;
  texture.minFilter = minified ? LinearMipmapLinearFilter : LinearFilter;
  texture.generateMipmaps = minified && !compressed;
  return texture;
}

/** A vector for each lamp that there may be. */
function slots(value = 0): Vector3[] {
  return Array.from({ length: MAX_LAMPS }, () => new Vector3().setScalar(value));
}
