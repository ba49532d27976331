/** A learned field as GLSL for engines other than three.js: its text, and the numbers that the text reads. */

import type { FieldRecord } from "../extension.ts";
import { evaluateFrame } from "../graph/frame.ts";
import { FRAME_UNIFORM_LIMIT, type GlslProgram, printGlsl, type TexelTexture } from "../graph/glsl.ts";
import { only } from "../graph/part.ts";
import type { Graph } from "../graph/node.ts";
import type { StoredBuffer } from "../graph/stored.ts";

/** Up to this many multiply-adds a pixel, weights are literals of the shader. */
const INLINE_LIMIT = 4096;

/** GLSL of a field's inputs where they are not called as in `LightwellSurface`. */
const INPUTS: Readonly<Record<string, string>> = { light: "lightwellLamps[ lamp ]" };

/** Numbers of a uniform; they stay the same object, and their content follows `update`. */
export interface NumberUniform {
  readonly name: string;
  /** Numbers of one element. */
  readonly size: 3 | 4;
  readonly isArray: boolean;
  readonly values: Float32Array<ArrayBuffer>;
}

/** The radiance of a field for the lamps that it follows. */
export class EngineField {
  readonly record: FieldRecord;
  /** Numbers of the lamps that the field is evaluated for; none for a static field. */
  readonly lamps: readonly number[];
  private readonly graph: Graph;
  private readonly name: string;
  private readonly program: GlslProgram;
  private readonly frame: Float32Array<ArrayBuffer>;
  /** The light that the per-frame values belong to. */
  private evaluated = "";

  constructor(record: FieldRecord, index: number, lamps: readonly number[], weights?: "inline" | "texture") {
    this.record = record;
    this.lamps = lamps;
    this.graph = only(record.graph, "radiance");
    this.name = `lightwellField${index}`;
    const placement = weights ?? (this.graph.macs <= INLINE_LIMIT ? "inline" : "texture");
    this.program = printGlsl(this.graph, { name: this.name, weights: placement, lights: Math.max(lamps.length, 1) });
    const { frame } = this.program;
    if (frame?.kind === "texture")
      throw new Error(`field '${record.name}': expected at most ${FRAME_UNIFORM_LIMIT} vectors that depend on lamps alone, found ${frame.blocks * Math.max(lamps.length, 1)}; show it with three.js`);
    this.frame = new Float32Array(4 * (frame?.blocks ?? 0) * Math.max(lamps.length, 1));
  }

  /** GLSL of the field's uniforms and functions. */
  get code(): string {
    return this.program.code;
  }

  /** Tables of numbers that the text fetches from. */
  get textures(): readonly TexelTexture[] {
    return this.program.textures;
  }

  /** Pictures that the text samples, by the names of their samplers. */
  get pictures(): ReadonlyMap<string, StoredBuffer> {
    return this.program.pictures;
  }

  /** Whether the text reads texture coordinates. */
  get readsUv(): boolean {
    return this.graph.inputs.has("uv") || this.graph.inputs.has("uv1");
  }

  /** What depends on the lamps alone. */
  get uniforms(): readonly NumberUniform[] {
    const { frame } = this.program;
    return frame ? [{ name: frame.name, size: 4, values: this.frame, isArray: true }] : [];
  }

  /** GLSL statements that add the field's light to `sum`, for a surface `s`. */
  get statements(): string {
    const { parameters, frame } = this.program;
    const call = `${this.name}( ${parameters.map(({ name }) => INPUTS[name] ?? `s.${name}`).join(", ")} )`;
    if (this.lamps.length === 0) return `if ( lightwellShown.z > 0.0 ) sum += max( ${call}, 0.0 );`;
    return this.lamps
      .map((lamp, i) => `{ const int lamp = ${lamp}; ${frame?.slot ? `${frame.slot} = ${i};` : ""} if ( lightwellShown.y > 0.0 ) sum += lightwellTints[ lamp ] * max( ${call}, 0.0 ); }`)
      .join("\n  ");
  }

  /** Evaluate what depends on the lamps, when they have moved; `dimmers` are factors of the scene's own lamps. */
  update(places: readonly (readonly number[])[], dimmers: readonly number[]): void {
    const { frame } = this.program;
    if (!frame) return;
    const lights = this.lamps.length > 0 ? this.lamps.map((lamp) => places[lamp]!) : [[0, 0, 0]];
    const key = lights.join();
    if (key === this.evaluated) return;
    this.evaluated = key;
    const size = 4 * frame.blocks;
    lights.forEach((light, i) => void evaluateFrame(this.graph, { light: [...light], lamps: dimmers }, this.frame.subarray(size * i, size * (i + 1))));
  }
}
