/** A glTF scene lit by its declared lights (rasterised) and by its learned fields, for `WebGLRenderer`. */

import { type Camera, DoubleSide, type Scene, type WebGLRenderer } from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import { inlineLimit } from "./device.ts";
import type { FieldRecord } from "./extension.ts";
import { FieldProgram } from "./field-program.ts";
import { FRAME_UNIFORM_LIMIT } from "./graph/glsl.ts";
import type { HalfResolution } from "./half-resolution.ts";
import type { Lamp } from "./lamp.ts";
import type { LitParts } from "./lit-objects.ts";
import { learnedLight } from "./loaded-light.ts";
import { FULL, type Look, looksOf, SEGMENT_OUTPUTS } from "./look.ts";
import { type DisposeOptions, SceneCore, type SceneOptions } from "./scene-core.ts";
import { learnedFinish, type SceneUniforms, type SurfaceFinish } from "./surface-finish.ts";
import { type Finisher, type SurfaceLook, SurfaceMaterials } from "./surface-materials.ts";
import { SurfacePatch } from "./surface-patch.ts";

/** Options of a `LearnedScene`; on a rasteriser without a GPU, larger fields are literals. */
export type LearnedSceneOptions = SceneOptions<WebGLRenderer>;

/** Scenes so far: their shaders differ, and so must their names. */
let scenes = 0;

/** Print some outputs of one of `count` fields that a surface evaluates. */
function print({ renderer, weights }: LearnedSceneOptions, record: FieldRecord, name: string, count: number, outputs: readonly string[] = ["radiance"]): FieldProgram {
  const placement = weights ?? (record.graph.macs <= inlineLimit(renderer) ? "inline" : "texture");
  return new FieldProgram(record, name, outputs, placement, Math.floor(FRAME_UNIFORM_LIMIT / count));
}

/**
 * Lights a loaded file: its declared lamps, and its learned light in the materials of its meshes, which are patched in place.
 *
 * Add `root` to a three.js scene, enable shadow maps, call `update` before each frame and `dispose` at the end. The root may
 * stand anywhere and be scaled, alike along all axes; lamps are three.js lights that may be moved and dimmed as any other.
 * Full resolution needs nothing else; other looks are drawn by `render`.
 */
export class LearnedScene extends SceneCore<FieldProgram, WebGLRenderer> {
  protected readonly materials: SurfaceMaterials;
  private readonly uniforms: SceneUniforms;
  private readonly segments: FieldProgram | null;
  /** Names the programs of this scene. */
  private readonly id = scenes++;
  /** How every look that is at hand finishes a surface; rare ones are loaded when they are compiled. */
  private readonly finishes: Map<SurfaceLook, SurfaceFinish>;
  private half: HalfResolution | null = null;
  /** What is drawn; `look` is what will be, once it is compiled. */
  private drawn: Look | "plain" = FULL;
  private look: Look = FULL;

  constructor(gltf: GLTF, options: LearnedSceneOptions = {}) {
    super(gltf, options, (record, i, count) => print(options, record, `lightwellField${i}`, count));
    const { fields, glass } = learnedLight(gltf);
    const segmented = fields.find((record) => record.graph.outputs.has("segment"));
    this.segments = segmented ? print(options, segmented, "lightwellSegment", fields.length, SEGMENT_OUTPUTS) : null;
    this.uniforms = { lightwellRaster: { value: 1 }, lightwellToRoot: { value: this.placement.toRoot } };
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
    return this.drawn !== "plain" && this.drawn.segments;
  }

  override get macs(): number {
    return this.look.half ? super.macs / 4 : super.macs;
  }

  /**
   * Compile the shaders of a look without holding up the page: until this resolves, the scene is drawn as before, or with
   * direct light alone. The renderer must be set to the target that will be drawn into; `scene` holds `root` and all lights.
   * Rejects with a `FormatError` when the materials ask for more textures or uniforms than the renderer offers.
   */
  async compile(renderer: WebGLRenderer, scene: Scene, camera: Camera, look = this.look): Promise<void> {
    this.look = {
      half: look.half && this.fields.length > 0,
      segments: look.segments && this.segments !== null,
    };
    const wanted = this.look;
    const generation = ++this.generation;
    this.checkBudget(renderer);
    const target = renderer.getRenderTarget();
    await this.loadLook(wanted);
    if (generation !== this.generation) return;
    // Without this extension nobody can tell when the shaders are ready: the next frame waits for them.
    if (renderer.extensions.has("KHR_parallel_shader_compile")) {
      const drawnInto = renderer.getRenderTarget();
      renderer.setRenderTarget(target);
      // The compilation of all that is worn starts at once; only the waiting is asynchronous.
      const compiled = looksOf(wanted).map((shown) => {
        this.materials.show(shown);
        return renderer.compileAsync(shown === "indirect" ? this.root : scene, camera);
      });
      this.materials.show("learned");
      renderer.setRenderTarget(drawnInto);
      await Promise.all(compiled);
    }
    if (generation === this.generation) this.drawn = wanted;
  }

  /** Draw with learned light, or with the shaders that have none: when its own fail or are not yet compiled. */
  useFields(on: boolean): void {
    this.drawn = on ? this.look : "plain";
  }

  /** Draw `scene`, which holds `root`, into the renderer's current target of `width` × `height` pixels. */
  render(
    renderer: WebGLRenderer,
    scene: Scene,
    camera: Camera,
    width: number,
    height: number,
  ): void {
    this.shadows.ask(this.lamps, renderer);
    const looks = this.drawn === "plain" ? (["plain"] as const) : looksOf(this.drawn);
    for (const look of looks) {
      this.materials.show(look);
      if (look !== "indirect") renderer.render(scene, camera);
      else this.drawSmall(renderer, this.half!, camera, width, height);
    }
    // Between frames, meshes have the materials of their owner.
    this.materials.show("learned");
  }

  private drawSmall(renderer: WebGLRenderer, half: HalfResolution, camera: Camera, width: number, height: number): void {
    half.fit(camera, width, height);
    const outer = renderer.getRenderTarget();
    renderer.setRenderTarget(half.target);
    renderer.clear();
    renderer.render(this.root as unknown as Scene, camera);
    renderer.setRenderTarget(outer);
  }

  override dispose(options: DisposeOptions = {}): void {
    this.half?.dispose();
    super.dispose(options);
  }

  protected override get programs(): readonly FieldProgram[] {
    return this.segments ? [...this.fields, this.segments] : this.fields;
  }

  protected override setLamps(lamps: readonly Lamp[]): void {
    super.setLamps(lamps);
    // Direct light alone is drawn until `compile` has run.
    this.drawn = "plain";
  }

  protected showRaster(on: boolean): void {
    this.uniforms.lightwellRaster.value = on ? 1 : 0;
  }

  protected demands(renderer: WebGLRenderer | undefined) {
    return { fields: this.fields.map((field) => field.demand), capabilities: renderer?.capabilities };
  }

  protected litParts(records: readonly FieldRecord[]): LitParts<FieldProgram> {
    const fields = records.map((record, i) => print(this.options, record, `lightwellProbes${i}`, records.length));
    const finish = learnedFinish(`probes${this.id}`, fields, this.uniforms, this.keepsEnvironment);
    const looks = new Map([...this.finishes].filter(([look]) => look === "plain")).set("learned", finish);
    const finisher = finisherOf(looks);
    return { fields, materials: () => new SurfaceMaterials(finisher) };
  }

  private get keepsEnvironment(): boolean {
    return this.options.environment === "keep" || this.fields.length === 0;
  }

  private createFinishes(): Map<SurfaceLook, SurfaceFinish> {
    const { fields, uniforms, id, keepsEnvironment } = this;
    const plain = learnedFinish("plain", [], uniforms, keepsEnvironment);
    const finishes = new Map<SurfaceLook, SurfaceFinish>([["plain", plain]]);
    if (this.hasLightmaps) finishes.set("lightmap", plain);
    if (fields.length > 0) finishes.set("learned", learnedFinish(`learned${id}`, fields, uniforms, keepsEnvironment));
    return finishes;
  }

  /** Load what a look needs and most pages do not. */
  private async loadLook({ half, segments }: Look): Promise<void> {
    const { finishes, fields, uniforms, id } = this;
    if (half && !this.half) {
      const { HalfResolution, indirectFinish, upsampledFinish } = await import("./half-resolution.ts");
      this.half ??= new HalfResolution();
      finishes.set("indirect", indirectFinish(`indirect${id}`, fields, uniforms));
      finishes.set("upsampled", upsampledFinish(this.half, uniforms, this.keepsEnvironment));
    }
    if (segments && !finishes.has("segments")) {
      const { segmentFinish } = await import("./segments.ts");
      finishes.set("segments", segmentFinish(`segments${id}`, this.segments!, uniforms));
    }
  }
}

function finisherOf(looks: ReadonlyMap<SurfaceLook, SurfaceFinish>): Finisher {
  const patch: Finisher["patch"] = (material, look, original) => new SurfacePatch(material, looks.get(look)!, original as SurfacePatch | undefined);
  // A path tracer sees both sides of a sheet as blockers; so must the shadow map.
  return { looks, patch, shadowSide: DoubleSide };
}
