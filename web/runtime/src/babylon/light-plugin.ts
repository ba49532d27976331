/** Adds direct and learned light to a physically based material of Babylon.js. */

import { MaterialPluginBase } from "@babylonjs/core/Materials/materialPluginBase.js";
import type { MaterialDefines } from "@babylonjs/core/Materials/materialDefines.js";
import type { PBRBaseMaterial } from "@babylonjs/core/Materials/PBR/pbrBaseMaterial.js";
import type { SubMesh } from "@babylonjs/core/Meshes/subMesh.js";
import type { BaseTexture } from "@babylonjs/core/Materials/Textures/baseTexture.js";
import type { UniformBuffer } from "@babylonjs/core/Materials/uniformBuffer.js";
import type { AbstractEngine } from "@babylonjs/core/Engines/abstractEngine.js";
import type { Scene } from "@babylonjs/core/scene.js";
import type { Effect } from "@babylonjs/core/Materials/effect.js";

/** What a plug-in asks of the light of its file. */
export interface PluginSource {
  /** Names the program: files have other texts. */
  readonly id: number;
  readonly code: string;
  readonly uniformNames: readonly string[];
  readonly samplerNames: readonly string[];
  readonly activeTextures: readonly BaseTexture[];
  bind(effect: Effect): void;
}

/** Where the names of Babylon.js' shader become those of ours; what is UNLIT shows its own colour. */
const ADD = /* glsl */ `
#ifndef UNLIT
{
  LightwellSurface lightwell = lightwellSurface( lightwellToFile, vPositionW, geometricNormalW, normalW, viewDirectionW, baseColor,
    reflectivityOut.dielectricColorF0, reflectivityOut.roughness, reflectivityOut.metallic, mat3( view ) );
#ifdef MAINUV1
  lightwell.uv = vMainUV1;
#endif
#ifdef MAINUV2
  lightwell.uv1 = vMainUV2;
#endif
  finalColor.rgb += lightwellShade( lightwell );
}
#endif`;

/** The plug-in; its material shows the light of one file. */
export class LearnedLightPlugin extends MaterialPluginBase {
  /** Null once the light is taken off: Babylon.js keeps every plug-in in its material for good. */
  private source: PluginSource | null;
  /** Its define. */
  private readonly define: string;

  constructor(material: PBRBaseMaterial, source: PluginSource) {
    const define = `LIGHTWELL${source.id}`;
    super(material, "LearnedLight", 300, { [define]: true }, false, false);
    this.source = source;
    this.define = define;
    // `hardBindForSubMesh` is one of those events.
    this.registerForExtraEvents = true;
    // To be listed is to be asked for the text.
    this._pluginManager._addPlugin(this);
    this._enable(true);
  }

  override getClassName(): string {
    return "LearnedLightPlugin";
  }

  /** Take the light off again. */
  remove(): void {
    this.source = null;
    this.markAllDefinesAsDirty();
  }

  override prepareDefinesBeforeAttributes(defines: MaterialDefines): void {
    // Another define is another program.
    if (!this.source) return void Object.assign(defines, { [this.define]: false });
    // Coordinates that maps of the material may not use.
    Object.assign(defines, { _needUVs: true, MAINUV1: true, MAINUV2: true });
  }

  override getCustomCode(shaderType: string): { [point: string]: string } | null {
    if (shaderType !== "fragment" || !this.source) return null;
    return { CUSTOM_FRAGMENT_DEFINITIONS: `uniform mat4 lightwellToFile;\n${this.source.code}`, CUSTOM_FRAGMENT_BEFORE_FOG: ADD };
  }

  override getUniforms() {
    return { externalUniforms: this.source ? ["lightwellToFile", ...this.source.uniformNames] : [] };
  }

  override getSamplers(samplers: string[]): void {
    if (this.source) samplers.push(...this.source.samplerNames);
  }

  override getActiveTextures(textures: BaseTexture[]): void {
    if (this.source) textures.push(...this.source.activeTextures);
  }

  override hardBindForSubMesh(_buffer: UniformBuffer, _scene: Scene, _engine: AbstractEngine, subMesh: SubMesh): void {
    if (subMesh.effect) this.source?.bind(subMesh.effect);
  }
}
