/** A glTF scene lit by its declared lights (rasterised) and by its learned fields, for three.js' `WebGPURenderer`. */

import type { Camera, DirectionalLight, Object3D, PointLight, RenderTarget, Scene } from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import { lights, materialEmissive, vec3 } from "three/tsl";
import type { FieldRecord } from "../extension.ts";
import { learnedLight } from "../loaded-light.ts";
import type { LitParts } from "../lit-objects.ts";
import { FULL, type Look, looksOf, SEGMENT_OUTPUTS } from "../look.ts";
import { type DisposeOptions, SceneCore, type SceneOptions } from "../scene-core.ts";
import { type Finisher, type SurfaceLook, SurfaceMaterials } from "../surface-materials.ts";
import { TO_REST } from "../to-rest.ts";
import { capabilitiesOf, type DeviceOwner, takesWgsl } from "./device.ts";
import { type AnyNode, FieldNodes, type SurfaceNodes } from "./field-nodes.ts";
import type { HalfNodes } from "./half-nodes.ts";
import { reflectanceNode, surfaceNodes } from "./learned-radiance.ts";
import { type NodeFinish, NodePatch, type SurfaceProperties } from "./node-patch.ts";
import { setupLightingModel } from "./principled-model.ts";
import { RendererShadows } from "./renderer-shadows.ts";

/** Up to this many multiply-adds a pixel, weights become literals of the shader. */
const INLINE_LIMIT = 4096;

const vector = vec3 as AnyNode;

/** Options of a `LearnedNodeScene`; without a renderer, materials may ask for what every device offers. */
export type LearnedNodeSceneOptions = SceneOptions<DeviceOwner>;

/** A `WebGPURenderer` as far as scenes draw and compile with it. */
export interface NodeRenderer extends DeviceOwner {
  getRenderTarget(): RenderTarget | null;
  setRenderTarget(target: RenderTarget | null): unknown;
  clear(): unknown;
  compileAsync(scene: Object3D, camera: Camera): Promise<unknown>;
  render(scene: Object3D, camera: Camera): unknown;
  getMRT(): unknown;
  setMRT(mrt: never): unknown;
}

/** Scenes so far: their shaders differ, and so must their names. */
let scenes = 0;

/**
 * As `LearnedScene`, for `WebGPURenderer`. Add `root` to a scene, call `update` before each frame and `dispose` at the end. Full
 * resolution needs nothing else; other looks are drawn by `render`.
 */
export class LearnedNodeScene extends SceneCore<FieldNodes, DeviceOwner> {
  protected readonly materials: SurfaceMaterials;
  private readonly segments: FieldNodes | null;
  private readonly id = scenes++;
  /** How every look that is at hand finishes a surface; rare ones are loaded when they are compiled. */
  private readonly finishes: Map<SurfaceLook, NodeFinish>;
  private half: HalfNodes | null = null;
  private raster = true;
  /** What is drawn; `look` is what will be, once it is compiled. */
  private drawn: Look = FULL;
  private look: Look = FULL;

  constructor(gltf: GLTF, options: LearnedNodeSceneOptions = {}) {
    super(gltf, options, (record, i) => new FieldNodes(record, `lightwellField${i}`, placementOf(record, options)));
    const { fields, glass } = learnedLight(gltf);
    const segmented = fields.find((record) => record.graph.outputs.has("segment"));
    this.segments = segmented ? new FieldNodes(segmented, "lightwellSegment", placementOf(segmented, options), SEGMENT_OUTPUTS) : null;
    this.finishes = this.createFinishes();
    this.materials = new SurfaceMaterials(finisherOf(this.finishes), this.lightmaps, glass);
    this.begin();
  }

  /** Whether any field says which expert shades a point. */
  get hasSegments(): boolean {
    return this.segments !== null;
  }

  /** Whether the segmentation is drawn now. */
  get showsSegments(): boolean {
    return this.drawn.segments;
  }

  override get macs(): number {
    return this.look.half ? super.macs / 4 : super.macs;
  }

  /**
   * Compile the shaders of a look without holding up the page: until this resolves, `render` draws what it did before. The renderer
   * must be set to the target that will be drawn into; `scene` holds `root` and all lights. Rejects with a `FormatError` when the
   * materials ask for more than the device offers.
   */
  async compile(renderer: NodeRenderer, scene: Scene, camera: Camera, look = this.look): Promise<void> {
    this.look = { half: look.half && this.fields.length > 0, segments: look.segments && this.segments !== null };
    const wanted = this.look;
    const generation = ++this.generation;
    this.checkBudget(renderer);
    const target = renderer.getRenderTarget();
    await this.loadLook(wanted);
    if (generation !== this.generation) return;
    // The small picture is compiled when it is first drawn: three.js would leave its targets set between the frames of the page.
    const shown = looksOf(wanted).at(-1)!;
    this.materials.show(shown);
    const compiled = this.into(renderer, target, renderer.getMRT(), () => renderer.compileAsync(scene, camera));
    // What is to be compiled is known: frames may be drawn meanwhile.
    this.materials.show("learned");
    await compiled;
    if (generation === this.generation) this.drawn = wanted;
  }

  /** Draw `scene`, which holds `root`, into the renderer's current target of `width` × `height` pixels. */
  render(renderer: NodeRenderer, scene: Scene, camera: Camera, width: number, height: number): void {
    this.shadows.ask(this.lamps, renderer);
    for (const look of looksOf(this.drawn)) {
      this.materials.show(look);
      if (look !== "indirect") renderer.render(scene, camera);
      else this.drawSmall(renderer, this.half!, camera, width, height);
    }
    // Between frames, meshes have the materials of their owner.
    this.materials.show("learned");
  }

  override dispose(options: DisposeOptions = {}): void {
    this.half?.dispose();
    super.dispose(options);
  }

  override update(renderer?: DeviceOwner, delta?: number): void {
    for (const { object } of this.lamps) {
      // The light of an environment map that turns casts no shadow.
      if (!("shadow" in object)) continue;
      const light = object as PointLight | DirectionalLight;
      light.shadow.shadowNode ??= new RendererShadows(light) as AnyNode;
    }
    super.update(renderer, delta);
  }

  protected override get programs(): readonly FieldNodes[] {
    return this.segments ? [...this.fields, this.segments] : this.fields;
  }

  /** Shaders differ: those without rasterised light have no lights at all. */
  protected showRaster(on: boolean): void {
    if (on === this.raster) return;
    this.raster = on;
    this.renew();
  }

  protected demands(renderer: DeviceOwner | undefined) {
    const wgsl = takesWgsl(renderer);
    return { fields: this.fields.map((field) => field.demand(wgsl)), capabilities: capabilitiesOf(renderer) };
  }

  protected litParts(records: readonly FieldRecord[]): LitParts<FieldNodes> {
    const fields = records.map((record, i) => new FieldNodes(record, `lightwellProbes${i}`, placementOf(record, this.options)));
    const finish = this.finish("learned", (own, surface) => this.withRaster(own, reflectanceNode().mul(radianceOf(fields, surface))), fields);
    const looks = new Map([...this.finishes].filter(([look]) => look === "plain")).set("learned", finish);
    const finisher = finisherOf(looks);
    return { fields, materials: () => new SurfaceMaterials(finisher) };
  }

  private drawSmall(renderer: NodeRenderer, half: HalfNodes, camera: Camera, width: number, height: number): void {
    half.fit(camera, width, height);
    this.into(renderer, half.target, half.targets, () => {
      renderer.clear();
      renderer.render(this.root, camera);
    });
  }

  /** Do something with a target set, and with what is drawn into several targets at once. */
  private into<T>(renderer: NodeRenderer, target: RenderTarget | null, targets: AnyNode, act: () => T): T {
    const [outer, others] = [renderer.getRenderTarget(), renderer.getMRT()];
    renderer.setRenderTarget(target);
    renderer.setMRT(targets as never);
    const result = act();
    renderer.setMRT(others as never);
    renderer.setRenderTarget(outer);
    return result;
  }

  private createFinishes(): Map<SurfaceLook, NodeFinish> {
    const plain = this.finish("plain", (own) => this.withRaster(own, vector(0)));
    const finishes = new Map<SurfaceLook, NodeFinish>([["plain", plain]]);
    if (this.hasLightmaps) finishes.set("lightmap", plain);
    if (this.fields.length > 0)
      finishes.set("learned", this.finish("learned", (own, surface) => this.withRaster(own, reflectanceNode().mul(this.radiance(surface)))));
    return finishes;
  }

  /** Load what a look needs and most pages do not. */
  private async loadLook({ half, segments }: Look): Promise<void> {
    const { finishes } = this;
    if (half && !this.half) {
      const { HalfNodes, smallTargets, upsampledNode } = await import("./half-nodes.ts");
      const made = (this.half ??= new HalfNodes());
      finishes.set("indirect", this.finish("indirect", (_, surface) => ({ ...alone(this.radiance(surface)), mrtNode: smallTargets(surface) })));
      finishes.set("upsampled", this.finish("upsampled", (own, surface) => this.withRaster(own, reflectanceNode().mul(upsampledNode(made, surface)))));
    }
    if (segments && !finishes.has("segments")) {
      const { segmentNode } = await import("./segment-nodes.ts");
      finishes.set("segments", this.finish("segments", (_, surface) => alone(segmentNode(this.segments!, surface))));
    }
  }

  /** A finish from the nodes of the surface that fields are told of. */
  private finish(look: SurfaceLook, properties: (own: SurfaceProperties, surface: SurfaceNodes) => SurfaceProperties, probes?: readonly FieldNodes[]): NodeFinish {
    const name = look === "plain" ? look : `${probes ? "probes" : look}${this.id}`;
    return {
      key: (material) =>
        `${name}:${(probes ?? this.fields).map((field) => field.lamps).join()}:${this.raster}:${this.keepsEnvironment}:${TO_REST.has(material) ? material.uuid : ""}`,
      properties: (own, material) => {
        // What moves is told where it rests.
        const toRest = TO_REST.get(material);
        return properties(own, surfaceNodes(probes ?? this.programs, { toRoot: this.placement.toRoot, ...(toRest ? { toRest } : {}) }));
      },
    };
  }

  private get keepsEnvironment(): boolean {
    return this.options.environment === "keep" || this.fields.length === 0;
  }

  /** Rasterised light, where it is shown, with what is added to it. */
  private withRaster({ emissiveNode, envNode, lightsNode }: SurfaceProperties, added: AnyNode): SurfaceProperties {
    return {
      setupLightingModel,
      lightsNode: this.raster ? lightsNode : lights([]),
      envNode: this.keepsEnvironment && this.raster ? envNode : vector(0),
      emissiveNode: vector(emissiveNode ?? materialEmissive).mul(this.raster ? 1 : 0).add(added),
    };
  }

  /** The sum of all fields, demodulated by the reflectance. */
  private radiance(surface: SurfaceNodes): AnyNode {
    return radianceOf(this.fields, surface);
  }
}

const radianceOf = (fields: readonly FieldNodes[], surface: SurfaceNodes): AnyNode => fields.map((field) => field.radiance(surface)).reduce((a, b) => a.add(b));

const placementOf = ({ graph }: FieldRecord, { weights }: LearnedNodeSceneOptions) => weights ?? (graph.macs <= INLINE_LIMIT ? "inline" : "texture");

function finisherOf(looks: ReadonlyMap<SurfaceLook, NodeFinish>): Finisher {
  const patch: Finisher["patch"] = (material, look, original) => new NodePatch(material, looks.get(look)!, original as NodePatch | undefined);
  // Lights that are not of the file are tested by three.js, which needs the sides that it chooses.
  return { looks, patch, shadowSide: null };
}

/** A material that shows this and no light. */
function alone(shown: AnyNode): SurfaceProperties {
  return { setupLightingModel, lightsNode: lights([]), envNode: vector(0), emissiveNode: shown };
}
