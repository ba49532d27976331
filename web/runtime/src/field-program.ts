/** A learned field as GLSL: its functions, the call that evaluates it, and the uniforms that it needs. */

import {
  DataTexture,
  FloatType,
  HalfFloatType,
  type IUniform,
  LinearFilter,
  LinearMipmapLinearFilter,
  NearestFilter,
  RGBAFormat,
  type Texture,
  type TextureDataType,
  Vector3,
} from "three";
import type { FieldRecord } from "./extension.ts";
import {
  evaluateFrame,
  FRAME_UNIFORM_LIMIT,
  type FrameUniform,
  frameLayout,
  type GlslProgram,
  type Graph,
  only,
  printGlsl,
  type StoredBuffer,
  type TexelTexture,
} from "./graph/index.ts";
import type { Demand } from "./material-budget.ts";
import { MAX_LAMPS } from "./variables.ts";

/** Where a field's weights live in the shader. */
export type WeightPlacement = "inline" | "texture";

/** GLSL of the graph's inputs inside a function of a surface where it is not their name; `light` is that of the loop. */
const INPUTS: Readonly<Record<string, string>> = { uv: "uv.xy", uv1: "uv.zw" };

/**
 * Some outputs of a field, printed for any number of lamps that the field is evaluated for. The uniforms are the same
 * objects whatever that number is, so that programs compiled for different numbers can share them.
 */
export class FieldProgram {
  readonly record: FieldRecord;
  /** The part of the record's graph that the outputs need. */
  readonly graph: Graph;
  /** Name of the function and prefix of everything else. */
  readonly name: string;
  readonly uniforms: Record<string, IUniform> = {};
  readonly placement: WeightPlacement;
  private readonly share: number;
  private program: GlslProgram;
  /** Values of the declared light that the field is evaluated for; shared with the lamps. */
  private lights: readonly Vector3[] = [];
  private readonly lightSlots = slots();
  private readonly gainSlots = slots();
  /** Per-frame values of every lamp, and the lights that they were evaluated for. */
  private frameValues: Float32Array<ArrayBuffer> = new Float32Array(0);
  private readonly evaluated = Array.from({ length: MAX_LAMPS }, () => new Vector3(Number.NaN, 0, 0));
  private readonly textures = new Map<string, DataTexture>();
  private readonly pictures: readonly Texture[];

  /** `share`: vectors that per-frame values may take of the uniforms; beyond it they are a texture. */
  constructor(
    record: FieldRecord,
    name: string,
    outputs: readonly string[],
    placement: WeightPlacement,
    share = FRAME_UNIFORM_LIMIT,
  ) {
    this.record = record;
    this.share = share;
    this.graph = only(record.graph, ...outputs);
    this.name = name;
    this.placement = placement;
    this.uniforms[`${name}_light`] = { value: this.lightSlots };
    this.uniforms[`${name}_gain`] = { value: this.gainSlots };
    this.program = this.print(1);
    for (const texels of this.program.textures) this.uniforms[texels.name] = { value: this.texture(texels) };
    this.pictures = [...this.program.pictures].map(([sampler, buffer]) => {
      const texture = asPicture(buffer);
      this.uniforms[sampler] = { value: texture };
      return texture;
    });
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

  /** Whether the surface must hand over its texture coordinates. */
  get readsUv(): boolean {
    return this.graph.inputs.has("uv") || this.graph.inputs.has("uv1");
  }

  /** GLSL text of the field's functions and uniforms, for the lamps that it follows now. */
  get code(): string {
    const size = `[ ${this.lamps} ]`;
    return `uniform vec3 ${this.name}_light${size};\nuniform vec3 ${this.name}_gain${size};\n${this.program.code}`;
  }

  /** What the program asks of a shader. */
  get demand(): Demand {
    const { textures, pictures, frame } = this.program;
    return {
      text: this.code.length,
      textures: textures.length + pictures.size + (frame?.kind === "texture" ? 1 : 0),
      uniforms: 2 * this.lamps + (frame?.kind === "array" ? frame.blocks * this.lamps : 0),
    };
  }

  /** Type of the GLSL value that `call` yields. */
  get type(): string {
    return this.program.type;
  }

  /** GLSL call, where `light` and the other inputs of a surface are in scope. */
  get call(): string {
    return `${this.name}( ${this.program.parameters.map((parameter) => INPUTS[parameter.name] ?? parameter.name).join(", ")} )`;
  }

  /** GLSL expression of an output of the graph, as one to four components of the value of `call`. */
  output(name: string, value: string): string {
    if (!this.program.type.endsWith("_result")) return value;
    const width = this.graph.widths.get(this.graph.outputs.get(name)!)!;
    return `${value}.o${[...this.graph.outputs.keys()].indexOf(name)}[ 0 ].${"xyzw".slice(0, width)}`;
  }

  /** GLSL statements for every lamp, for which `light` and `gain` are set. */
  forEachLamp(statements: string): string {
    const { name } = this;
    const slot = this.program.frame?.slot;
    // A loop of one step costs rasterisers on the CPU a good part of a frame: its body runs under a mask.
    const head = this.lamps > 1 ? `for ( int lamp = 0; lamp < ${this.lamps}; lamp ++ ) {` : "{ const int lamp = 0;";
    return `${head}
    vec3 light = ${name}_light[ lamp ], gain = ${name}_gain[ lamp ];
    ${slot ? `${slot} = lamp;` : ""}
    ${statements}
  }`;
  }

  /** Follow these lights (at least one); after a change of their number the shaders must be compiled anew. */
  follow(lights: readonly Vector3[]): void {
    this.lights = lights;
    this.program = this.print(lights.length);
    for (const evaluated of this.evaluated) evaluated.set(Number.NaN, 0, 0);
  }

  /** Set what the value for a lamp is multiplied by: colour times intensity, or 0 where it is off. */
  setGain(lamp: number, gain: Vector3): void {
    this.gainSlots[lamp]!.copy(gain);
  }

  /** Evaluate the per-frame part of each light that has moved; call before drawing. */
  update(): void {
    this.lights.forEach((light, lamp) => {
      this.lightSlots[lamp]!.copy(light);
      if (!this.program.frame || this.evaluated[lamp]!.equals(light)) return;
      this.evaluated[lamp]!.copy(light);
      const { blocks } = this.program.frame;
      const values = this.frameValues.subarray(4 * blocks * lamp, 4 * blocks * (lamp + 1));
      evaluateFrame(this.graph, { light: light.toArray() }, values);
      const texture = this.textures.get(this.program.frame.name);
      if (texture) texture.needsUpdate = true;
    });
  }

  dispose(): void {
    for (const texture of [...this.textures.values(), ...this.pictures]) texture.dispose();
  }

  private sum(bytesOf: (buffer: StoredBuffer) => number): number {
    return Math.round([...this.record.buffers.values()].reduce((sum, buffer) => sum + bytesOf(buffer), 0));
  }

  private print(lights: number): GlslProgram {
    const frameTexture = lights * frameLayout(this.graph).blocks > this.share;
    const program = printGlsl(this.graph, { name: this.name, weights: this.placement, lights, frameTexture });
    if (program.frame) this.addFrame(program.frame);
    return program;
  }

  private addFrame({ name, kind, blocks }: FrameUniform): void {
    if (this.uniforms[name]) return;
    if (this.frameValues.length === 0) this.frameValues = new Float32Array(4 * blocks * MAX_LAMPS);
    const data = this.frameValues;
    const texels = { name, width: blocks, height: MAX_LAMPS, format: "rgba32float", data } as const;
    this.uniforms[name] = { value: kind === "array" ? data : this.texture(texels) };
  }

  private texture({ name, data, width, height, format }: TexelTexture): DataTexture {
    const type: TextureDataType = format === "rgba16float" ? HalfFloatType : FloatType;
    const texture = new DataTexture(data, width, height, RGBAFormat, type);
    texture.minFilter = texture.magFilter = NearestFilter;
    texture.needsUpdate = true;
    this.textures.set(name, texture);
    return texture;
  }
}

/** The texture of a buffer that is a picture, set up to be sampled as far down its mipmaps as it may be. */
export function asPicture(buffer: StoredBuffer): Texture {
  const texture = buffer.picture!.source as Texture;
  const minified = buffer.picture!.mips > 0;
  texture.magFilter = LinearFilter;
  texture.minFilter = minified ? LinearMipmapLinearFilter : LinearFilter;
  texture.generateMipmaps = minified;
  return texture;
}

/** A vector for each lamp that there may be. */
function slots(): Vector3[] {
  return Array.from({ length: MAX_LAMPS }, () => new Vector3());
}
