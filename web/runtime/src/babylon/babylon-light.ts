/** The learned light of a file that Babylon.js has loaded. */

import { Constants } from "@babylonjs/core/Engines/constants.js";
import { Light } from "@babylonjs/core/Lights/light.js";
import type { Effect } from "@babylonjs/core/Materials/effect.js";
import { PBRBaseMaterial } from "@babylonjs/core/Materials/PBR/pbrBaseMaterial.js";
import type { PBRMaterial } from "@babylonjs/core/Materials/PBR/pbrMaterial.js";
import type { BaseTexture } from "@babylonjs/core/Materials/Textures/baseTexture.js";
import { RawTexture } from "@babylonjs/core/Materials/Textures/rawTexture.js";
import { Matrix } from "@babylonjs/core/Maths/math.vector.js";
import type { AbstractMesh } from "@babylonjs/core/Meshes/abstractMesh.js";
import type { Scene } from "@babylonjs/core/scene.js";
import { isClear } from "../clear-glass.ts";
import { EngineLight, type EngineParts } from "../engines/engine-light.ts";
import { SHADOW_TAPS } from "../engines/point-shadow.ts";
import { coreDiagonal } from "../core-record.ts";
import type { NeuralRadiance } from "../extension.ts";
import type { TexelTexture } from "../graph/glsl.ts";
import { BabylonLamp } from "./babylon-lamp.ts";
import { LearnedLightPlugin, type PluginSource } from "./light-plugin.ts";

/** Options of the learned light. */
export interface BabylonLightOptions {
  /** Whether surfaces of the file also take the light of an environment, which learned light has already: `remove` unless given. */
  readonly environment?: "keep" | "remove";
  /** Where weights live; by default small fields are literals and large ones textures. */
  readonly weights?: "inline" | "texture";
}

/** Files so far: their shaders differ. */
let files = 0;

/** Lights the meshes of one file; it follows lamps and root by itself before every frame. */
export class LearnedLight implements PluginSource {
  readonly id = files++;
  readonly root: AbstractMesh;
  readonly lamps: readonly BabylonLamp[];
  readonly code: string;
  private readonly light: EngineLight;
  private readonly textures = new Map<string, BaseTexture>();
  private readonly plugins: LearnedLightPlugin[] = [];
  private readonly stand: { root: AbstractMesh; meshes: AbstractMesh[]; diagonal: number; core: number; toWorld: Matrix; toFile: Matrix };
  private readonly observer: { remove(): void };
  private readonly undo: (() => void)[] = [];

  constructor(radiance: NeuralRadiance, root: AbstractMesh, scene: Scene, { environment = "remove", weights }: BabylonLightOptions = {}) {
    this.root = root;
    this.light = new EngineLight(radiance, weights);
    const { min, max } = root.getHierarchyBoundingVectors();
    const diagonal = max.subtract(min).length() || 1;
    this.stand = { root, meshes: root.getChildMeshes(), diagonal, core: diagonal, toWorld: Matrix.Identity(), toFile: Matrix.Identity() };
    this.place();
    if (radiance.core) this.stand.core = Math.min(diagonal, coreDiagonal(radiance.core) * Math.cbrt(Math.abs(this.stand.toWorld.determinant())));
    this.removeOwnLights();
    this.lamps = this.light.lamps.map((lamp, i) => new BabylonLamp(lamp, i, scene, this.stand));
    this.code = this.light.code(`${SHADOW_TAPS}\n${this.lamps.map((lamp) => lamp.code).join("\n")}`, new Set(this.lamps.keys()));
    for (const table of this.light.textures) this.textures.set(table.name, rawTexture(table, scene));
    for (const [name, { picture }] of this.light.pictures) this.textures.set(name, picture!.source as BaseTexture);
    this.patch(environment === "keep", radiance.glass);
    this.observer = scene.onBeforeRenderObservable.add(() => this.update());
  }

  /** Choose which parts of the light are shown. */
  show(parts: EngineParts): void {
    this.light.show(parts);
  }

  /** Follow lamps and root; done by itself before every frame. Throws when the root is scaled unevenly. */
  update(): void {
    this.place();
    for (const lamp of this.lamps) lamp.follow();
    this.light.update();
  }

  get uniformNames(): readonly string[] {
    return [...this.light.uniforms.map(({ name }) => name), ...this.lamps.flatMap((lamp) => lamp.uniforms)];
  }

  get samplerNames(): readonly string[] {
    return [...this.textures.keys(), ...this.lamps.map((lamp) => lamp.sampler)];
  }

  get activeTextures(): readonly BaseTexture[] {
    return [...this.textures.values()];
  }

  bind(effect: Effect): void {
    effect.setMatrix("lightwellToFile", this.stand.toFile);
    for (const { name, size, values } of this.light.uniforms) {
      if (size === 4) effect.setFloatArray4(name, values);
      else effect.setFloatArray3(name, values);
    }
    for (const [name, texture] of this.textures) effect.setTexture(name, texture);
    for (const lamp of this.lamps) lamp.bind(effect);
  }

  /** Give the file's materials and lights back, and free what was made for its light. */
  dispose(): void {
    this.observer.remove();
    for (const plugin of this.plugins) plugin.remove();
    for (const lamp of this.lamps) lamp.dispose();
    for (const texture of this.textures.values()) texture.dispose();
    for (const undo of this.undo.splice(0)) undo();
  }

  /** Look at where the root stands. */
  private place(): void {
    const { root, stand } = this;
    stand.toWorld = root.computeWorldMatrix(true).clone();
    stand.toFile = Matrix.Invert(stand.toWorld);
    const m = stand.toWorld.asArray();
    const scales = [0, 4, 8].map((i) => Math.hypot(m[i]!, m[i + 1]!, m[i + 2]!)) as [number, number, number];
    if (Math.max(...scales) > 1.001 * Math.min(...scales))
      throw new Error(`LearnedLight '${root.name}': expected axes of one scale, found ${scales.map((x) => x.toPrecision(3)).join(", ")}; scale all axes alike`);
  }

  /** The light of the file's own lights is learned. */
  private removeOwnLights(): void {
    for (const node of this.root.getDescendants(false)) {
      if (!(node instanceof Light) || !node.isEnabled()) continue;
      node.setEnabled(false);
      this.undo.push(() => node.setEnabled(true));
    }
  }

  /** Give every material of the file the light. */
  private patch(keepsEnvironment: boolean, glass?: boolean): void {
    const materials = new Set(this.stand.meshes.map((mesh) => mesh.material));
    for (const material of materials) {
      if (!(material instanceof PBRBaseMaterial) || (!glass && isGlass(material))) continue;
      this.plugins.push(new LearnedLightPlugin(material, this));
      if (keepsEnvironment) continue;
      const lit = material as PBRMaterial;
      const { environmentIntensity } = lit;
      lit.environmentIntensity = 0;
      this.undo.push(() => void (lit.environmentIntensity = environmentIntensity));
    }
  }
}

function isGlass(material: PBRBaseMaterial): boolean {
  const { subSurface, roughness } = material as PBRMaterial;
  return subSurface.isRefractionEnabled && isClear(subSurface.refractionIntensity, roughness ?? 1);
}

function rawTexture({ data, width, height, format }: TexelTexture, scene: Scene): RawTexture {
  const type = format === "rgba16float" ? Constants.TEXTURETYPE_HALF_FLOAT : Constants.TEXTURETYPE_FLOAT;
  return new RawTexture(data, width, height, Constants.TEXTUREFORMAT_RGBA, scene, false, false, Constants.TEXTURE_NEAREST_SAMPLINGMODE, type);
}
