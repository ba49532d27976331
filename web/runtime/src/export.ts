/** `lightwell/export`: a learned field as one self-contained shader text, for engines other than three.js. */

import { FormatError } from "./checks.ts";
import { DIALECTS, type DialectName } from "./graph/dialects.ts";
import { type Graph, only, printGlsl, printWgsl, type StoredBuffer } from "./graph/index.ts";
import { printDialect } from "./graph/print-dialect.ts";
import { shadertoy } from "./shadertoy.ts";

export const EXPORT_TARGETS = ["glsl", "wgsl", "shadertoy", "hlsl", "msl", "gdshader"] as const;
export type ExportTarget = (typeof EXPORT_TARGETS)[number];

export interface ExportOptions {
  readonly to: ExportTarget;
  /** Name of the function and prefix of everything else. */
  readonly name?: string;
  /** How the header calls the field. */
  readonly title?: string;
  /** `inline`: networks are literals. `table`: loops over a texture (GLSL) or storage buffer (WGSL). */
  readonly weights?: "inline" | "table";
  /** Corners of the space that a position roams, for a Shadertoy, which shows a slice of it. */
  readonly bounds?: { readonly low: readonly number[]; readonly high: readonly number[] };
  /** What moves, in the order of the numbers of `pose`, such as `Door, 0 to 90 degrees`: the header says it. */
  readonly movers?: readonly string[];
}

/** Numbers that the text cannot hold and that the host must bind. */
export interface ExportedTable {
  /** Name of the uniform. */
  readonly name: string;
  readonly format: "rgba16float" | "rgba32float" | "storage";
  readonly width: number;
  readonly height: number;
  readonly data: Uint16Array | Float32Array;
}

export interface ExportedShader {
  readonly text: string;
  readonly tables: readonly ExportedTable[];
  /** Pictures that the host must bind, by the names of their uniforms. */
  readonly pictures: ReadonlyMap<string, StoredBuffer>;
}

/** What every input of a field is; `light` depends on the declared light. */
const MEANINGS: Readonly<Record<string, string>> = {
  position: "surface point, world space, metres",
  normal: "unit vertex normal, world space, on the side of the eye, without normal map",
  view: "unit direction from the point to the eye",
  lamps: "what each of the scene's own lamps is multiplied by: red of all lamps, then green, then blue",
  pose: "of each thing that moves 0 at the first value of its range, 1 at the last",
  rest_position: "where the surface point is when all that moves is at rest; position itself for what stands still",
  rest_normal: "normal there; normal itself for what stands still",
  light: "position of the declared point light in metres, or unit direction to the declared sun",
  reflectance: "base colour + 0.04 (1 - metallic), at least 0.001, linear",
  roughness: "glTF roughness",
  metallic: "glTF metallic",
  shading_normal: "unit normal after the material's normal map, world space, on the side of the eye",
  uv: "texture coordinates 0, origin at the top left",
  uv1: "texture coordinates 1 (the light map's), origin at the top left",
};

const DEFAULT_NAME = "lightwell";
const NAME = /^[A-Za-z][A-Za-z0-9_]{0,31}$/;

/** Print the radiance of a graph for a language. Throws a `FormatError` for what the target cannot hold. */
export function exportShader(given: Graph, options: ExportOptions): ExportedShader {
  const { to, name = DEFAULT_NAME } = options;
  if (!NAME.test(name) || name.includes("__")) throw new FormatError("name: expected letters, digits and _ (at most 32)");
  const graph = unframed(only(given, "radiance"));
  if (to === "wgsl") return exportWgsl(graph, name, options);
  if (to in DIALECTS) return exportDialect(graph, to as DialectName, name, options);
  const shader = exportGlsl(graph, name, options);
  if (to === "glsl") return shader;
  if (shader.tables.length > 0 || shader.pictures.size > 0) {
    throw new FormatError("shadertoy: expected a field without textures or tables; export glsl instead");
  }
  return { ...shader, text: shadertoy(graph, name, shader.text, options.bounds) };
}

/** The same graph with everything evaluated per pixel: the text needs nobody to fill in what depends on the frame. */
function unframed(graph: Graph): Graph {
  const nodes = graph.nodes.map((node) => ({ ...node, perFrame: false }));
  return { ...graph, nodes, macs: graph.macs + graph.macsPerFrame, macsPerFrame: 0 };
}

function exportGlsl(graph: Graph, name: string, options: ExportOptions): ExportedShader {
  const program = printGlsl(graph, { name, weights: options.weights === "table" ? "texture" : "inline" });
  const tables = program.textures.map(({ name: uniform, ...rest }) => ({ ...rest, name: uniform }));
  const bindings = [
    ...tables.map((t) => `${t.name}: ${t.width} x ${t.height} texels, ${t.format.toUpperCase()}, nearest, no mipmaps`),
    ...[...program.pictures].map(([uniform, buffer]) => pictureNote(uniform, buffer)),
  ];
  const type = (width: number) => (width > 4 ? `vec4[${Math.ceil(width / 4)}]` : width === 1 ? "float" : `vec${width}`);
  const call = `vec3 ${name}(${program.parameters.map((p) => `${type(p.width)} ${p.name}`).join(", ")})`;
  const head = header("GLSL ES 3.00 with precision highp float and int", graph, call, bindings, options);
  return { text: `${head}\n${program.code}\n`, tables, pictures: program.pictures };
}

/** Where a text of a language goes, and whether anything ever compiled it: `docs/export.md`. */
const DIALECT_NOTES: Readonly<Record<DialectName, string>> = {
  hlsl: "HLSL, shader model 5; textures are parameters of the function",
  msl: "Metal shading language 2, after `#include <metal_stdlib>` and `using namespace metal;`; textures are parameters of the function; never compiled by Apple's compiler",
  gdshader: "Godot 4 shading language, to be included in a shader and called in fragment(); never compiled by Godot",
};

function exportDialect(graph: Graph, to: DialectName, name: string, options: ExportOptions): ExportedShader {
  const program = printDialect(graph, DIALECTS[to], { name, weights: options.weights === "table" ? "texture" : "inline" });
  const bindings = [
    ...program.textures.map((t) => `${t.name}: ${t.width} x ${t.height} texels, ${t.format.toUpperCase()}, nearest, no mipmaps`),
    ...[...program.pictures].map(([uniform, buffer]) => pictureNote(uniform, buffer)),
  ];
  const named = program.parameters.reduce((text, p, i) => text.replace(new RegExp(`\\bi${i}\\b`), p.name), program.signature);
  const head = header(DIALECT_NOTES[to], graph, named, bindings, options);
  return { text: `${head}\n${program.code}\n`, tables: program.textures, pictures: program.pictures };
}

function exportWgsl(graph: Graph, name: string, options: ExportOptions): ExportedShader {
  const program = printWgsl(graph, { name, weights: options.weights === "table" ? "storage" : "inline", fragment: true });
  const table = program.weights;
  const tables = table
    ? [{ name: table.name, format: "storage" as const, width: table.size[0], height: 1, data: table.data }]
    : [];
  const bindings = [
    ...tables.map((t) => `@binding(0) ${t.name}: ${t.width} vec4f, a read-only storage buffer`),
    ...program.pictures.map((p) => `@binding(${p.binding}) ${pictureNote(p.name, p.buffer)}; @binding(${p.binding + 1}) its sampler`),
  ];
  const type = (width: number) => (width > 4 ? `array<vec4f, ${Math.ceil(width / 4)}>` : width === 1 ? "f32" : `vec${width}f`);
  const call = `fn ${name}(${program.parameters.map((p) => `${p.name}: ${type(p.width)}`).join(", ")}) -> vec3f`;
  const pictures = new Map(program.pictures.map((p) => [p.name, p.buffer]));
  const needsFragment = program.pictures.some(({ buffer }) => buffer.picture!.mips > 0);
  const where = `WGSL${needsFragment ? ", in uniform control flow of a fragment shader" : ""}; bindings in group 0`;
  return { text: `${header(where, graph, call, bindings, options)}\n${program.code}\n`, tables, pictures };
}

function pictureNote(uniform: string, { shape, picture }: StoredBuffer): string {
  const mips = picture!.mips > 0 ? `linear with mipmaps (levels 0 to ${picture!.mips} are read)` : "linear, no mipmaps";
  return `${uniform}: ${shape[1]} x ${shape[0]} texels, RGBA8 UNORM (not sRGB), first row at v = 0, clamped, ${mips}`;
}

/** The comment in front: what to call with what, and what comes back. */
function header(where: string, graph: Graph, call: string, bindings: readonly string[], { title = "", movers = [] }: ExportOptions): string {
  const of = (input: string) => (input === "pose" ? movers.map((mover) => ` (${plain(mover)})`).join("") : "");
  const inputs = [...graph.inputs].map(([input]) => `//   ${input}: ${MEANINGS[input] ?? "see format/FORMAT.md"}${of(input)}`);
  const bound = bindings.length ? ["//", "// Bind:", ...bindings.map((text) => `//   ${text}`)] : [];
  return [
    `// Learned light${title ? ` '${plain(title)}'` : ""}, exported by lightwell.`,
    `// ${where}. ${graph.macs} multiply-adds.`,
    "//",
    `// ${call}`,
    ...inputs,
    "// Returns radiance that still lacks two factors: add reflectance * max(result, 0) to the outgoing radiance, times",
    "// colour and intensity of the declared light when the field follows one.",
    ...bound,
  ].join("\n");
}

/** A text of a file for one line of a comment. */
function plain(text: string): string {
  return text.replace(/[^\x20-\x7e]|\\/g, "?").slice(0, 120);
}
