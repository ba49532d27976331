/** A probe volume on the graphics card, and materials of `WebGLRenderer` that are lit by it. */

import { DataTexture, type IUniform, type Material, NearestFilter, RGBAIntegerFormat, UnsignedIntType } from "three";
import { type ProbeFile, readProbes } from "./file.ts";
import { replacePart } from "../shader-part.ts";
import { probesGlsl, ROW_BITS } from "./shader.ts";

/** How a material asks a volume. */
export interface ProbeUse {
  /** 0: learned weights. For comparison: 1 trilinear ones of the probes in air, 2 of all, 3 distance moments (`file.baselines`). */
  readonly mode: IUniform<number>;
  /** The mode that view 3 compares with. */
  readonly other: IUniform<number>;
  /** Factor of the irradiance. */
  readonly intensity: IUniform<number>;
  /** What is drawn: 0 the lit material, 1 the irradiance, 2 trust, 3 learned light less that of `other`, 4 the share of a probe. */
  readonly view: IUniform<number>;
  /** Metres along the normal at which a surface that stands still asks; 0 for what moves. */
  readonly offset: IUniform<number>;
  /** The probe of view 4. */
  readonly probe: IUniform<number>;
}

let volumes = 0;

/** A shader with text after one of three.js' chunks. */
function addAfter(shader: string, [chunk, text]: readonly string[]): string {
  const part = `#include <${chunk}>`;
  return replacePart(shader, part, `${part}\n${text}`);
}

/** Probes that light what moves. `dispose()` frees the texture. */
export class ProbeVolume {
  readonly file: ProbeFile;
  /** Prefix of all names in shaders. */
  readonly name = `lwProbes${volumes++}`;
  /** The words, four in a texel. */
  readonly texture: DataTexture;
  private readonly uses = new WeakMap<Material, ProbeUse>();

  constructor(file: ProbeFile | ArrayBuffer) {
    this.file = file instanceof ArrayBuffer ? readProbes(file) : file;
    const width = 1 << ROW_BITS;
    const height = Math.max(1, Math.ceil(this.file.words.length / (4 * width)));
    const words = new Uint32Array(4 * width * height);
    words.set(this.file.words);
    this.texture = new DataTexture(words, width, height, RGBAIntegerFormat, UnsignedIntType);
    this.texture.minFilter = this.texture.magFilter = NearestFilter;
    this.texture.needsUpdate = true;
  }

  /** Place of a node of the lattice, metres. */
  node(number: number): [number, number, number] {
    const { origin, spacing, shape } = this.file;
    const at = [number % shape[0], Math.floor(number / shape[0]) % shape[1], Math.floor(number / (shape[0] * shape[1]))];
    return origin.map((o, k) => o + spacing * at[k]!) as [number, number, number];
  }

  /** Whether a probe holds light. */
  alive(number: number): boolean {
    return this.file.words[4 * this.file.at.nodes + 4 * number]! > 0;
  }

  /**
   * Light a standard (or any other lit) material of `WebGLRenderer` by this volume, on top of what lights it already.
   * `still`: the surface does not move, and asks a little off itself. Returns what can be changed at any time; the same for a material
   * that it lights already.
   */
  light(material: Material, still = false): ProbeUse {
    const offset = still ? this.file.offset * this.file.spacing : 0;
    const known = this.uses.get(material);
    if (known) {
      known.offset.value = offset;
      return known;
    }
    const use: ProbeUse = {
      mode: { value: 0 },
      other: { value: 1 },
      intensity: { value: 1 },
      view: { value: 0 },
      offset: { value: offset },
      probe: { value: -1 },
    };
    this.uses.set(material, use);
    const { name, texture } = this;
    // That of a class is the text of the hook: read before there is another one.
    const key = material.customProgramCacheKey();
    const before = material.onBeforeCompile;
    material.onBeforeCompile = (shader, renderer) => {
      before.call(material, shader, renderer);
      Object.assign(shader.uniforms, {
        [`${name}_words`]: { value: texture },
        [`${name}_u_mode`]: use.mode,
        [`${name}_u_other`]: use.other,
        [`${name}_u_gain`]: use.intensity,
        [`${name}_u_view`]: use.view,
        [`${name}_u_probe`]: use.probe,
        [`${name}_u_offset`]: use.offset,
      });
      shader.vertexShader = [
        ["common", `varying vec3 ${name}_place;`],
        ["project_vertex", placing(name)],
      ].reduce(addAfter, shader.vertexShader);
      shader.fragmentShader = [
        ["common", `${declared(name)}${probesGlsl(this.file, name)}`],
        ["lights_fragment_maps", asking(name)],
        ["opaque_fragment", showing(name)],
      ].reduce(addAfter, shader.fragmentShader);
    };
    material.customProgramCacheKey = () => `${key}${name}`;
    material.needsUpdate = true;
    return use;
  }

  dispose(): void {
    this.texture.dispose();
  }
}

const placing = (name: string) => `
{
  vec4 lwPlace = vec4(transformed, 1.0);
  #ifdef USE_INSTANCING
    lwPlace = instanceMatrix * lwPlace;
  #endif
  ${name}_place = (modelMatrix * lwPlace).xyz;
}`;

const declared = (name: string) => `
varying vec3 ${name}_place;
uniform highp usampler2D ${name}_words;
uniform int ${name}_u_mode, ${name}_u_other, ${name}_u_view, ${name}_u_probe;
uniform float ${name}_u_gain, ${name}_u_offset;
vec4 ${name}_answer = vec4(0.0);
vec3 ${name}_other = vec3(0.0);
`;

const asking = (name: string) => `
#if defined(RE_IndirectDiffuse)
{
  vec3 lwNormal = inverseTransformDirection(normal, viewMatrix);
  vec3 lwAt = ${name}_place + ${name}_u_offset * lwNormal;
  ${name}_probe = ${name}_u_probe;
  if (${name}_u_view == 3) {
    ${name}_mode = ${name}_u_other;
    ${name}_other = ${name}(lwAt, lwNormal).rgb;
  }
  ${name}_mode = ${name}_u_view == 3 ? 0 : ${name}_u_mode;
  ${name}_answer = ${name}(lwAt, lwNormal);
  irradiance += ${name}_u_gain * ${name}_answer.rgb;
}
#endif`;

const showing = (name: string) => `
if (${name}_u_view == 1) gl_FragColor.rgb = ${name}_u_gain * ${name}_answer.rgb / 3.14159265;
if (${name}_u_view == 2) gl_FragColor.rgb = mix(vec3(0.6, 0.02, 0.02), vec3(0.02, 0.3, 0.6), ${name}_answer.w);
if (${name}_u_view == 3) {
  float lwLess = dot(${name}_u_gain * (${name}_answer.rgb - ${name}_other), vec3(0.2126, 0.7152, 0.0722));
  gl_FragColor.rgb = lwLess < 0.0 ? vec3(0.02, 0.05, 0.02 - lwLess) : vec3(0.02 + lwLess, 0.05, 0.02);
}
if (${name}_u_view == 4) gl_FragColor.rgb = mix(vec3(0.02), vec3(1.0, 0.6, 0.05), ${name}_share);`;
