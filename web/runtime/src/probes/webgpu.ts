/** `lightwell/probes/webgpu`: a probe volume as a light of `WebGPURenderer`, on WebGPU or its WebGL 2 fallback. */

import { Light } from "three";
import { normalWorld, positionWorld, texture, uniform, vec2 } from "three/tsl";
import { AnalyticLightNode, Node, Vector2 } from "three/webgpu";
import type { AnyNode } from "../webgpu/field-nodes.ts";
import { probesGlsl, probesWgsl } from "./shader.ts";
import { ProbeVolume } from "./volume.ts";

export { ProbeVolume };

/**
 * A light that adds the irradiance of a volume to every lit material of the scene. Materials that must not be lit (surfaces whose
 * learned light is there already) choose their lights themselves, by `material.lightsNode`.
 *
 *     scene.add(new ProbeVolumeLight(new ProbeVolume(await response.arrayBuffer())));
 */
export class ProbeVolumeLight extends Light {
  readonly isProbeVolumeLight = true;
  readonly volume: ProbeVolume;

  constructor(volume: ProbeVolume, intensity = 1) {
    super(0xffffff, intensity);
    // three.js asks a light's prototype for its node.
    if (!Object.hasOwn(ProbeVolumeLight.prototype, "_lightNode")) (ProbeVolumeLight as AnyNode).registerNode(ProbeVolumeLightNode);
    Object.assign(this, { type: "ProbeVolumeLight" });
    this.volume = volume;
  }
}

const isWgsl = (builder: AnyNode): boolean => builder.renderer.backend.isWebGPUBackend === true;

/** The functions of a volume, once a shader, under the name that three.js gave to the texture. */
class ProbeCode extends (Node as AnyNode) {
  readonly volume: ProbeVolume;
  words: AnyNode;

  constructor(volume: ProbeVolume) {
    super("void");
    this.volume = volume;
  }

  setup(): null {
    this.words = texture(this.volume.texture, vec2(new Vector2()));
    return null;
  }

  generate(builder: AnyNode): void {
    const { file, name } = this.volume;
    const text = isWgsl(builder) ? probesWgsl(file, name) : probesGlsl(file, name);
    const property = this.words.build(builder, "property") as string;
    builder.getCodeFromNode(this, "void").code = text.replaceAll(`${name}_words`, property);
  }
}

/** The answer of a volume at a place, for a normal: (irradiance, trusted share). */
class ProbeAnswer extends (Node as AnyNode) {
  readonly code: ProbeCode;
  readonly place: AnyNode;
  readonly normal: AnyNode;

  constructor(volume: ProbeVolume, place: AnyNode, normal: AnyNode) {
    super("vec4");
    [this.code, this.place, this.normal] = [new ProbeCode(volume), place, normal];
  }

  generate(builder: AnyNode): string {
    this.code.build(builder);
    return `${this.code.volume.name}(${this.place.build(builder, "vec3")}, ${this.normal.build(builder, "vec3")})`;
  }
}

/** A node of TSL: (irradiance, trusted share) of a volume. Surfaces that stand still add `file.offset * file.spacing * normal`. */
export const probeIrradiance = (volume: ProbeVolume, place: AnyNode = positionWorld, normal: AnyNode = normalWorld): AnyNode =>
  new ProbeAnswer(volume, place, normal).toVar();

class ProbeVolumeLightNode extends (AnalyticLightNode as AnyNode) {
  readonly gain: AnyNode;

  constructor(light: ProbeVolumeLight) {
    super(light);
    this.gain = (uniform as AnyNode)(light?.intensity ?? 1);
  }

  update(frame: AnyNode): void {
    super.update(frame);
    this.gain.value = this.light.intensity;
  }

  setup(builder: AnyNode): void {
    builder.context.irradiance.addAssign(probeIrradiance(this.light.volume).xyz.mul(this.gain));
  }
}
