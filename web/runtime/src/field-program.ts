/** A learned field as GLSL for `WebGLRenderer`: its functions, the call that evaluates it, and the uniforms that it needs. */

import type { IUniform } from "three";
import type { FieldRecord } from "./extension.ts";
import { FRAME_UNIFORM_LIMIT, type GlslProgram, printGlsl } from "./graph/glsl.ts";
import { LearnedField, pictureTexture, texelTexture, type WeightPlacement } from "./learned-field.ts";
import type { Demand } from "./material-budget.ts";

/** GLSL of the graph's inputs inside a function of a surface where it is not their name; `light` is that of the loop. */
const INPUTS: Readonly<Record<string, string>> = { uv: "uv.xy", uv1: "uv.zw" };

/** Some outputs of a field, printed for the lamps that it follows. */
export class FieldProgram extends LearnedField {
  readonly uniforms: Record<string, IUniform> = {};
  private readonly share: number;
  private program: GlslProgram;

  /** `share`: vectors that per-frame values may take of the uniforms; beyond it they are a texture. */
  constructor(
    record: FieldRecord,
    name: string,
    outputs: readonly string[],
    placement: WeightPlacement,
    share = FRAME_UNIFORM_LIMIT,
  ) {
    super(record, name, outputs, placement);
    this.share = share;
    this.uniforms[`${name}_light`] = { value: this.lightSlots };
    this.uniforms[`${name}_gain`] = { value: this.gainSlots };
    this.program = this.print();
    const { textures, pictures } = this.program;
    for (const { name: key, data, width, height } of textures) this.bind(key, this.keep(key, () => texelTexture(data, width, height)));
    for (const [key, buffer] of pictures) this.bind(key, this.keep(key, () => pictureTexture(buffer)));
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

  override follow(lights: Parameters<LearnedField["follow"]>[0]): void {
    super.follow(lights);
    this.program = this.print();
  }

  private print(): GlslProgram {
    const { name, placement, lamps } = this;
    const frameTexture = lamps * this.blocks > this.share;
    const program = printGlsl(this.graph, { name, weights: placement, lights: lamps, frameTexture });
    const { frame } = program;
    if (frame) this.bind(frame.name, frame.kind === "array" ? this.frameValues : this.keepFrame(frame.name));
    return program;
  }

  /** Give a uniform its value, which stays the same object. */
  private bind(name: string, value: unknown): void {
    this.uniforms[name] ??= { value };
  }
}
