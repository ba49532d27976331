/** A learned field as GLSL: its functions, the call that evaluates it, and the uniforms that it needs. */

import {
  DataTexture,
  FloatType,
  HalfFloatType,
  type IUniform,
  NearestFilter,
  RGBAFormat,
  type TextureDataType,
  Vector3,
} from "three";
import type { FieldRecord } from "./extension.ts";
import { evaluateFrame, type FrameUniform, type GlslProgram, printGlsl } from "./graph/index.ts";

/** Where a field's weights live in the shader. */
export type WeightPlacement = "inline" | "texture";

/** GLSL expressions of the graph's inputs inside `lightwellRadiance`. */
const INPUTS: Readonly<Record<string, string>> = {
  position: "position",
  normal: "normal",
  view: "view",
  reflectance: "reflectance",
  roughness: "roughness",
  metallic: "metallic",
  uv: "uv.xy",
  uv1: "uv.zw",
};

/** One field, printed. */
export class FieldProgram {
  readonly record: FieldRecord;
  /** GLSL text of the field's functions and uniforms. */
  readonly code: string;
  /** GLSL expression of the demodulated radiance, over the parameters of `lightwellRadiance`. */
  readonly call: string;
  /** Name of the vec3 uniform that scales the field: colour times intensity, or 0 when it is off. */
  readonly gain: string;
  readonly uniforms: Record<string, IUniform>;
  readonly readsUv: boolean;
  readonly placement: WeightPlacement;
  /** Value of the declared light that the field follows; shared with its lamp. */
  private readonly light: Vector3;
  private readonly frame: FrameUniform | null;
  /** The light for which the per-frame part was evaluated. */
  private readonly evaluated = new Vector3(Number.NaN, 0, 0);
  private readonly textures: DataTexture[] = [];

  /** Print the field number `index` of a scene. */
  constructor(record: FieldRecord, index: number, light: Vector3, placement: WeightPlacement) {
    const name = `lightwellField${index}`;
    this.record = record;
    this.light = light;
    this.gain = `lightwellGain${index}`;
    this.placement = placement;
    const program = printGlsl(record.graph, { name, weights: this.placement });
    const lightName = `lightwellLight${index}`;
    this.code = `uniform vec3 ${this.gain};\nuniform vec3 ${lightName};\n${program.code}`;
    this.call = callOf(name, program, record, lightName);
    this.readsUv = program.parameters.some(
      (parameter) => parameter.name === "uv" || parameter.name === "uv1",
    );
    this.frame = program.frame;
    this.uniforms = { [this.gain]: { value: new Vector3() }, [lightName]: { value: light } };
    for (const { name, width, height, format, data } of program.textures) {
      const texture = this.addTexture(
        data,
        width,
        height,
        format === "rgba16float" ? HalfFloatType : FloatType,
      );
      this.uniforms[name] = { value: texture };
    }
    if (this.frame) this.addFrame(this.frame);
  }

  /** Multiply-adds per pixel. */
  get macs(): number {
    return this.record.graph.macs;
  }

  /** Bytes of the stored buffers. */
  get bytes(): number {
    return [...this.record.buffers.values()].reduce((sum, buffer) => sum + buffer.data.byteLength, 0);
  }

  /** Evaluate the per-frame part when the light has moved; call before drawing. */
  update(): void {
    if (!this.frame || this.evaluated.equals(this.light)) return;
    this.evaluated.copy(this.light);
    const uniform = this.uniforms[this.frame.name]!;
    const texture = this.frame.kind === "texture" ? (uniform.value as DataTexture) : null;
    const values = (texture ? texture.image.data : uniform.value) as Float32Array<ArrayBuffer>;
    evaluateFrame(this.record.graph, { light: this.light.toArray() }, values);
    if (texture) texture.needsUpdate = true;
  }

  dispose(): void {
    for (const texture of this.textures) texture.dispose();
  }

  private addFrame({ name, kind, blocks }: FrameUniform): void {
    const values = new Float32Array(4 * blocks) as Float32Array<ArrayBuffer>;
    this.uniforms[name] = {
      value: kind === "array" ? values : this.addTexture(values, blocks, 1, FloatType),
    };
  }

  private addTexture(
    data: Uint16Array<ArrayBuffer> | Float32Array<ArrayBuffer>,
    width: number,
    height: number,
    type: TextureDataType,
  ): DataTexture {
    const texture = new DataTexture(data, width, height, RGBAFormat, type);
    texture.minFilter = texture.magFilter = NearestFilter;
    texture.needsUpdate = true;
    this.textures.push(texture);
    return texture;
  }
}

/** The call of a printed graph, narrowed to its output `radiance`. */
function callOf(name: string, program: GlslProgram, record: FieldRecord, light: string): string {
  const inputs = program.parameters.map((parameter) =>
    parameter.name === "light" ? light : INPUTS[parameter.name]!,
  );
  const call = `${name}( ${inputs.join(", ")} )`;
  const output = [...record.graph.outputs.keys()].indexOf("radiance");
  return program.type === "vec3" ? call : `${call}.o${output}[ 0 ].xyz`;
}
