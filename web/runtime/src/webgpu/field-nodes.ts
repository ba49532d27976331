/** A learned field as a node of three.js' `WebGPURenderer`: WGSL on WebGPU, GLSL where it falls back to WebGL 2. */

import { DataTexture, FloatType, HalfFloatType, NearestFilter, RGBAFormat, type Texture, Vector2, Vector3 } from "three";
import { Node, type NodeBuilder } from "three/webgpu";
import { texture, uniform, vec2 } from "three/tsl";
import type { FieldRecord } from "../extension.ts";
import { asPicture } from "../field-program.ts";
import { evaluateFrame, frameLayout, type Graph, only, printGlsl, printWgsl } from "../graph/index.ts";
import type { Lamp } from "../lamp.ts";
import type { Demand } from "../material-budget.ts";

/** A node as three.js types it: its class has one type parameter too many to be worth spelling out. */
export type AnyNode = any;

/** Nodes of what a surface offers to a field, by the names of its inputs; `light` is the field's own. */
export type SurfaceNodes = Readonly<Record<string, AnyNode>>;

const VECTORS = ["", "float", "vec2", "vec3", "vec4"] as const;

/** One learned field for a fixed set of lamps: what shaders read, kept up to date. */
export class FieldNodes {
  readonly record: FieldRecord;
  readonly graph: Graph;
  /** Name of the function and prefix of everything else. */
  readonly name: string;
  /** Lamps that the field is evaluated for; empty for the light of the scene's own emitters. */
  readonly lamps: readonly Lamp[];
  /** Factor of each evaluation: the lamp's colour times its intensity. */
  readonly gains: readonly Vector3[];
  private readonly weights: "inline" | "texture";
  private readonly lights: readonly Vector3[];
  private readonly frame: DataTexture | null;
  /** Textures by the names that the printed text gives to them. */
  private readonly textures = new Map<string, Texture>();

  constructor(record: FieldRecord, name: string, lamps: readonly Lamp[], weights: "inline" | "texture") {
    this.record = record;
    this.graph = only(record.graph, "radiance");
    this.name = name;
    this.lamps = lamps;
    this.weights = weights;
    const count = Math.max(lamps.length, 1);
    this.gains = Array.from({ length: count }, () => new Vector3(1, 1, 1));
    this.lights = Array.from({ length: count }, () => new Vector3(Number.NaN, 0, 0));
    const { blocks } = frameLayout(this.graph);
    this.frame = blocks ? dataTexture(new Float32Array(4 * blocks * count), blocks, count) : null;
    this.update();
  }

  /** Sum over the lamps of gain · max(field, 0), demodulated by the reflectance. */
  radiance(surface: SurfaceNodes): AnyNode {
    const code = new FieldCode(this);
    const terms = this.gains.map((gain, slot) => {
      const light = (uniform as AnyNode)(this.lights[slot]);
      return new FieldCall(code, { ...surface, light }, slot).nodeOf().max(0).mul((uniform as AnyNode)(gain));
    });
    return terms.reduce((sum, term) => sum.add(term));
  }

  /** Follow the lamps: their places, and whatever of the field depends on them alone. Call before drawing. */
  update(): void {
    this.lamps.forEach(({ value, color, intensity }, slot) => {
      this.gains[slot]!.set(color.r, color.g, color.b).multiplyScalar(intensity);
      if (this.lights[slot]!.equals(value)) return;
      this.lights[slot]!.copy(value);
      if (!this.frame) return;
      const size = 4 * this.frame.image.width;
      const values = (this.frame.image.data as Float32Array<ArrayBuffer>).subarray(size * slot, size * (slot + 1));
      evaluateFrame(this.graph, { light: value.toArray() }, values);
      this.frame.needsUpdate = true;
    });
  }

  /** The text for a language, with the textures that it reads by name; `names` are those that the text gives to them. */
  print(wgsl: boolean, names: ReadonlyMap<string, string> = new Map()): { body: string; parameters: readonly string[]; slot: string | null; textures: Map<string, Texture> } {
    const { name, lights } = this;
    const used = new Map<string, Texture>();
    const keep = (key: string, make: () => Texture) => {
      const found = this.textures.get(key) ?? make();
      this.textures.set(key, found);
      used.set(key, found);
    };
    const options = { name, lights: lights.length, names } as const;
    if (wgsl) {
      const weights = this.weights === "inline" ? "inline" : "storage";
      const program = printWgsl(this.graph, { ...options, weights, textures: true, fragment: true });
      const { weights: table, frame } = program;
      if (table) keep(table.name, () => dataTexture(table.data, ...table.size));
      if (frame) keep(frame.name, () => this.frame!);
      for (const { name: picture, buffer } of program.pictures) keep(picture, () => asPicture(buffer));
      return { body: program.body, parameters: namesOf(program), slot: frame?.slot ?? null, textures: used };
    }
    const program = printGlsl(this.graph, { ...options, weights: this.weights, frameTexture: true });
    for (const { name: key, data, width, height } of program.textures) {
      keep(key, () => dataTexture(data, width, height));
    }
    if (program.frame) keep(program.frame.name, () => this.frame!);
    for (const [picture, buffer] of program.pictures) keep(picture, () => asPicture(buffer));
    return { body: program.body, parameters: namesOf(program), slot: program.frame?.slot ?? null, textures: used };
  }

  /** What the text for a language asks of a shader. */
  demand(wgsl: boolean): Demand {
    const { body, textures } = this.print(wgsl);
    return { text: body.length, textures: textures.size, uniforms: 2 * this.gains.length };
  }

  dispose(): void {
    this.frame?.dispose();
    for (const found of this.textures.values()) found.dispose();
  }
}

const namesOf = ({ parameters }: { parameters: readonly { name: string }[] }) => parameters.map(({ name }) => name);

function dataTexture(data: Float32Array<ArrayBuffer> | Uint16Array<ArrayBuffer>, width: number, height: number): DataTexture {
  const type = data instanceof Uint16Array ? HalfFloatType : FloatType;
  const made = new DataTexture(data, width, height, RGBAFormat, type);
  made.minFilter = made.magFilter = NearestFilter;
  made.needsUpdate = true;
  return made;
}

const isWgsl = (builder: NodeBuilder) =>
  (builder as AnyNode).renderer.backend.isWebGPUBackend === true;

/** The functions of a field, once a shader, whose texture names are those that three.js gave to its bindings. */
class FieldCode extends (Node as AnyNode) {
  readonly field: FieldNodes;
  /** Where three.js finds the textures that this node reads. */
  textureNodes: AnyNode[] = [];

  constructor(field: FieldNodes) {
    super("void");
    this.field = field;
  }

  setup(builder: NodeBuilder): null {
    const { textures } = this.field.print(isWgsl(builder));
    this.textureNodes = [...textures.values()].map((found) => texture(found, vec2(new Vector2())));
    return null;
  }

  generate(builder: AnyNode): { parameters: readonly string[]; call: string; slotted: boolean } {
    const wgsl = isWgsl(builder);
    const keys = [...this.field.print(wgsl).textures.keys()];
    const names = new Map(keys.map((key, i) => [key, this.textureNodes[i].build(builder, "property") as string]));
    const { body, parameters, slot } = this.field.print(wgsl, names);
    let text = body;
    // A private variable says for which lamp the per-frame values are read: set it inside of a call.
    const call = slot ? `${this.field.name}_for` : this.field.name;
    if (slot) text += `\n${wrapper(this.field, parameters, call, slot, wgsl)}`;
    builder.getCodeFromNode(this, "void").code = text;
    return { parameters, call, slotted: slot !== null };
  }
}

/** A function with the lamp's number in front of the parameters. */
function wrapper(field: FieldNodes, names: readonly string[], call: string, slot: string, wgsl: boolean): string {
  const widths = names.map((name) => field.graph.inputs.get(name)!);
  const given = widths.map((_, i) => `i${i}`).join(", ");
  if (wgsl) {
    const types = widths.map((width, i) => `i${i}: ${width === 1 ? "f32" : `vec${width}f`}`);
    return `fn ${call}(lamp: i32, ${types.join(", ")}) -> vec3f { ${slot} = lamp; return ${field.name}(${given}); }`;
  }
  const types = widths.map((width, i) => `${VECTORS[width]} i${i}`);
  return `vec3 ${call}(int lamp, ${types.join(", ")}) { ${slot} = lamp; return ${field.name}(${given}); }`;
}

/** The value of a field for one lamp. */
class FieldCall extends (Node as AnyNode) {
  readonly code: FieldCode;
  readonly surface: SurfaceNodes;
  readonly slot: number;

  constructor(code: FieldCode, surface: SurfaceNodes, slot: number) {
    super("vec3");
    this.code = code;
    this.surface = surface;
    this.slot = slot;
  }

  /** This node with the operators of TSL. */
  nodeOf(): AnyNode {
    return this.toVar();
  }

  generate(builder: AnyNode): string {
    const { parameters, call, slotted } = this.code.generate(builder);
    const given = parameters.map((name) => {
      const width = this.code.field.graph.inputs.get(name)!;
      return this.surface[name].build(builder, VECTORS[width]) as string;
    });
    const slot = isWgsl(builder) ? `${this.slot}i` : `${this.slot}`;
    return `${call}(${[...(slotted ? [slot] : []), ...given].join(", ")})`;
  }
}
