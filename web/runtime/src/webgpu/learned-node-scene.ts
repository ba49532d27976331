/** A glTF scene lit by its declared lights (rasterised) and by its learned fields, for three.js' `WebGPURenderer`. */

import { type Camera, type DirectionalLight, type Material, type Matrix4, type Object3D, type PointLight, type Scene } from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import { lights, materialEmissive, vec3 } from "three/tsl";
import { SceneCore, type SceneOptions } from "../scene-core.ts";
import { type Finisher, type SurfaceLook, SurfaceMaterials } from "../surface-materials.ts";
import { TO_REST } from "../to-rest.ts";
import { capabilitiesOf, type DeviceOwner, takesWgsl } from "./device.ts";
import { type AnyNode, FieldNodes } from "./field-nodes.ts";
import { reflectanceNode, surfaceNodes } from "./learned-radiance.ts";
import { type NodeFinish, NodePatch, type SurfaceProperties } from "./node-patch.ts";
import { setupLightingModel } from "./principled-model.ts";
import { RendererShadows } from "./renderer-shadows.ts";

/** Up to this many multiply-adds a pixel, weights become literals of the shader. */
const INLINE_LIMIT = 4096;

/** Options of a `LearnedNodeScene`; without a renderer, materials may ask for what every device offers. */
export type LearnedNodeSceneOptions = SceneOptions<DeviceOwner>;

/** A `WebGPURenderer` as far as `compile` uses it. */
export interface NodeRenderer extends DeviceOwner {
  compileAsync(scene: Object3D, camera: Camera): Promise<unknown>;
}

/** Scenes so far: their shaders differ, and so must their names. */
let scenes = 0;

/**
 * As `LearnedScene`, for `WebGPURenderer`, at full resolution. Add `root` to a scene, call `update` before each frame and `dispose` at the end.
 */
export class LearnedNodeScene extends SceneCore<FieldNodes, DeviceOwner> {
  protected readonly materials: SurfaceMaterials;
  private readonly id = scenes++;
  private raster = true;

  constructor(gltf: GLTF, options: LearnedNodeSceneOptions = {}) {
    super(gltf, options, (record, i) => {
      const placement = options.weights ?? (record.graph.macs <= INLINE_LIMIT ? "inline" : "texture");
      return new FieldNodes(record, `lightwellField${i}`, placement);
    });
    const finishes = this.createFinishes();
    const looks = new Set(Object.keys(finishes) as SurfaceLook[]);
    const patch: Finisher["patch"] = (material, look) => new NodePatch(material, finishes[look]!);
    // Lights that are not of the file are tested by three.js, which needs the sides that it chooses.
    this.materials = new SurfaceMaterials({ looks, patch, shadowSide: null }, this.lightmaps);
    this.begin();
  }

  /**
   * Compile the shaders without holding up the page. `scene` holds `root` and all lights. Rejects with a `FormatError` when the
   * materials ask for more than the device offers.
   */
  async compile(renderer: NodeRenderer, scene: Scene, camera: Camera): Promise<void> {
    this.checkBudget(renderer);
    await renderer.compileAsync(scene, camera);
  }

  override update(renderer?: DeviceOwner): void {
    for (const { object } of this.lamps) {
      const light = object as PointLight | DirectionalLight;
      light.shadow.shadowNode ??= new RendererShadows(light) as AnyNode;
    }
    super.update(renderer);
  }

  /** Shaders differ: those without rasterised light have no lights at all. */
  protected showRaster(on: boolean): void {
    if (on === this.raster) return;
    this.raster = on;
    this.materials.renew();
  }

  protected demands(renderer: DeviceOwner | undefined) {
    const wgsl = takesWgsl(renderer);
    return { fields: this.fields.map((field) => field.demand(wgsl)), capabilities: capabilitiesOf(renderer) };
  }

  private createFinishes(): Partial<Record<SurfaceLook, NodeFinish>> {
    const { fields } = this;
    const keep = this.options.environment === "keep" || fields.length === 0;
    const key = (look: string) => (material: Material) =>
      `${look}:${fields.map((field) => field.lamps).join()}:${this.raster}:${keep}:${TO_REST.has(material) ? material.uuid : ""}`;
    const vector = vec3 as AnyNode;
    const properties = ({ emissiveNode, envNode, lightsNode }: SurfaceProperties): SurfaceProperties => ({
      setupLightingModel,
      lightsNode: this.raster ? lightsNode : lights([]),
      envNode: keep && this.raster ? envNode : vector(0),
      emissiveNode: vector(emissiveNode ?? materialEmissive).mul(this.raster ? 1 : 0),
    });
    const plain: NodeFinish = { key: key("plain"), properties };
    const learned: NodeFinish = {
      key: key(`learned${this.id}`),
      properties: (own, material) => {
        const { emissiveNode, ...others } = properties(own);
        return { ...others, emissiveNode: emissiveNode.add(this.learnedLight(TO_REST.get(material))) };
      },
    };
    return { plain, ...(fields.length > 0 ? { learned } : {}), ...(this.hasLightmaps ? { lightmap: plain } : {}) };
  }

  /** Reflectance times the sum of all fields, for what moves where `toRest` is given. */
  private learnedLight(toRest: Matrix4 | undefined): AnyNode {
    const surface = surfaceNodes(this.fields, { toRoot: this.placement.toRoot, ...(toRest ? { toRest } : {}) });
    const sum = this.fields.map((field) => field.radiance(surface)).reduce((a, b) => a.add(b));
    return reflectanceNode().mul(sum);
  }
}
