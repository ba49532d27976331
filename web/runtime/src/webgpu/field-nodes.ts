/** A learned field as a node of three.js' `WebGPURenderer`: WGSL on WebGPU, GLSL where it falls back to WebGL 2. */

import { type Texture, Vector2 } from "three";
import { Node, type NodeBuilder } from "three/webgpu";
import { texture, uniform, vec2 } from "three/tsl";
import type { FieldRecord } from "../extension.ts";
import { printGlsl } from "../graph/glsl.ts";
import { printWgsl } from "../graph/wgsl.ts";
import { LearnedField, pictureTexture, texelTexture, type WeightPlacement } from "../learned-field.ts";
import type { Demand } from "../material-budget.ts";

/** A node of unknown type: three.js types the operators of a node by its type alone. */
export type AnyNode = any;

/** Nodes of what a surface offers to a field, by the names of its inputs; `light` is the field's own. */
export type SurfaceNodes = Readonly<Record<string, AnyNode>>;

const VECTORS = ["", "float", "vec2", "vec3", "vec4"] as const;

/** A printed field: its functions, and what they read. */
interface Printed {
  readonly body: string;
  /** Of the value of the function. */
  readonly type: string;
  readonly parameters: readonly string[];
  /** Private variable that says for which lamp per-frame values are read; null for one lamp. */
  readonly slot: string | null;
  readonly textures: ReadonlyMap<string, Texture>;
}

/** Some outputs of a field, its radiance unless others are asked for, printed for the lamps that it follows. */
export class FieldNodes extends LearnedField {
  private readonly asked: readonly string[];

  constructor(record: FieldRecord, name: string, placement: WeightPlacement, outputs: readonly string[] = ["radiance"]) {
    super(record, name, outputs, placement);
    this.asked = outputs;
  }

  /**
   * Three numbers of `found`, the value of the printed function: the first one of each output that was asked for, -1 for those that
   * the graph lacks. Null where the value is three numbers itself.
   */
  unpack(found: string): string | null {
    if (this.asked.length === 1) return null;
    const names = [...this.graph.outputs.keys()];
    const read = (name: string) => (names.length > 1 ? `${found}.o${names.indexOf(name)}[0].x` : found);
    return this.asked.map((name) => (names.includes(name) ? read(name) : "-1.0")).join(", ");
  }

  /** Sum over the lamps of gain · max(field, 0), demodulated by the reflectance: a node for the lamps that are followed now. */
  radiance(surface: SurfaceNodes): AnyNode {
    const code = new FieldCode(this);
    const terms = Array.from({ length: this.lamps }, (_, slot) => this.call(code, surface, slot).max(0).mul((uniform as AnyNode)(this.gainSlots[slot])));
    return terms.reduce((sum, term) => sum.add(term));
  }

  /** The numbers of `unpack`, for the first lamp. */
  values(surface: SurfaceNodes): AnyNode {
    return this.call(new FieldCode(this), surface, 0);
  }

  private call(code: FieldCode, surface: SurfaceNodes, slot: number): AnyNode {
    return new FieldCall(code, { ...surface, light: (uniform as AnyNode)(this.lightSlots[slot]) }, slot).nodeOf();
  }

  /** The text for a language, with the textures that it reads by name; `names` are those that the text gives to them. */
  print(wgsl: boolean, names: ReadonlyMap<string, string> = new Map()): Printed {
    const textures = new Map<string, Texture>();
    const keep = (key: string, make: () => Texture) => textures.set(key, this.keep(key, make));
    const options = { name: this.name, lights: this.lamps, names } as const;
    const found = (program: { body: string; type: string; parameters: readonly { name: string }[]; frame: { name: string; slot: string | null } | null }): Printed => {
      const { body, type, parameters, frame } = program;
      if (frame) textures.set(frame.name, this.keepFrame(frame.name));
      return { body, type, parameters: parameters.map(({ name }) => name), slot: frame?.slot ?? null, textures };
    };
    if (wgsl) {
      const weights = this.placement === "inline" ? "inline" : "storage";
      const program = printWgsl(this.graph, { ...options, weights, textures: true, fragment: true });
      const { weights: table, pictures } = program;
      if (table) keep(table.name, () => texelTexture(table.data, ...table.size));
      for (const { name, buffer } of pictures) keep(name, () => pictureTexture(buffer));
      return found(program);
    }
    const program = printGlsl(this.graph, { ...options, weights: this.placement, frameTexture: true });
    for (const { name, data, width, height } of program.textures) keep(name, () => texelTexture(data, width, height));
    for (const [name, buffer] of program.pictures) keep(name, () => pictureTexture(buffer));
    return found(program);
  }

  /** What the text for a language asks of a shader. */
  demand(wgsl: boolean): Demand {
    const { body, textures } = this.print(wgsl);
    return { text: body.length, textures: textures.size, uniforms: 2 * this.lamps };
  }
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
    const printed = this.field.print(wgsl, names);
    // A private variable says for which lamp the per-frame values are read: set it inside of a call.
    const slotted = printed.slot !== null || this.field.unpack("found") !== null;
    const call = slotted ? `${this.field.name}_for` : this.field.name;
    const text = slotted ? `${printed.body}\n${wrapper(this.field, printed, call, wgsl)}` : printed.body;
    builder.getCodeFromNode(this, "void").code = text;
    return { parameters: printed.parameters, call, slotted };
  }
}

/** A function with the lamp's number in front of the parameters, whose value is three numbers. */
function wrapper(field: FieldNodes, { parameters, slot, type }: Printed, call: string, wgsl: boolean): string {
  const widths = parameters.map((name) => field.graph.inputs.get(name)!);
  const given = widths.map((_, i) => `i${i}`).join(", ");
  const result = field.unpack("found") ?? "found";
  const choose = slot ? `${slot} = lamp; ` : "";
  if (wgsl) {
    const types = widths.map((width, i) => `i${i}: ${width === 1 ? "f32" : `vec${width}f`}`);
    return `fn ${call}(${["lamp: i32", ...types].join(", ")}) -> vec3f { ${choose}let found = ${field.name}(${given}); return vec3f(${result}); }`;
  }
  const types = widths.map((width, i) => `${VECTORS[width]} i${i}`);
  return `vec3 ${call}(${["int lamp", ...types].join(", ")}) { ${choose}${type} found = ${field.name}(${given}); return vec3(${result}); }`;
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
