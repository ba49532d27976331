/** A glTF scene lit by its declared lights (rasterised) and by its learned fields. */

import {
  type Box3,
  type Camera,
  Color,
  type Group,
  type Object3D,
  type Scene,
  type Texture,
  Vector3,
  type WebGLRenderer,
} from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import { inlineLimit } from "./device.ts";
import type { FieldRecord } from "./extension.ts";
import { FieldProgram, type WeightPlacement } from "./field-program.ts";
import { FRAME_UNIFORM_LIMIT } from "./graph/index.ts";
import { HalfResolution, upsampledFinish } from "./half-resolution.ts";
import { createLamp, type Lamp, ShadowKeeper } from "./lamp.ts";
import { type LoadedLight, learnedLight } from "./loader.ts";
import { checkMaterials } from "./material-budget.ts";
import { ADDED_SHARE, roomiestPlace, tintOf } from "./more-lamps.ts";
import { OwnLights } from "./own-lights.ts";
import { boundsOf, Placement } from "./placement.ts";
import { SEGMENT_OUTPUTS, segmentFinish } from "./segments.ts";
import { indirectFinish, learnedFinish, type SceneUniforms } from "./surface-finish.ts";
import { type SurfaceLook, SurfaceMaterials } from "./surface-materials.ts";
import { MAX_LAMPS, type Variable } from "./variables.ts";

/** Which parts of the light are shown. */
export interface Parts {
  /** Direct light of the declared lights, and emission. */
  readonly raster: boolean;
  /** Learned light of the declared lights. */
  readonly indirect: boolean;
  /** Learned light of the scene's own emitters. */
  readonly still: boolean;
}

/** Options of a `LearnedScene`. */
export interface LearnedSceneOptions {
  /** Where weights live; by default small fields are literals and large ones textures. */
  readonly weights?: WeightPlacement;
  /**
   * What will draw the scene: on a rasteriser without a GPU, larger fields are literals. With several renderers, call
   * `update` with each before it draws.
   */
  readonly renderer?: WebGLRenderer;
  /**
   * Whether surfaces also take the light of `scene.environment`: learned light has that of the bake already, so it is `remove`d
   * unless asked for. Lights that are not of the file always add to the picture, and fog lies over it.
   */
  readonly environment?: "keep" | "remove";
}

/** What `dispose` frees. */
export interface DisposeOptions {
  /** Textures of the model and of ordinary light maps too; true unless given. */
  readonly textures?: boolean;
}

/** How the learned light is drawn. */
export interface Look {
  /** Evaluate it at half the width and height, and bring it back by a joint bilateral filter. */
  readonly half: boolean;
  /** Show which expert shades each point instead of any light; only where `hasSegments`. */
  readonly segments: boolean;
}

/** Scenes so far: their shaders differ, and so must their names. */
let scenes = 0;

/** The scene that a root is attached to: a root has one. */
const OWNERS = new WeakMap<Object3D, LearnedScene>();

/**
 * Lights a loaded file: its declared lamps, and its learned light in the materials of its meshes, which are patched in place.
 *
 * Add `root` to a three.js scene, enable shadow maps, call `update` before each frame and `dispose` at the end. The root may
 * stand anywhere and be scaled, alike along all axes; lamps are three.js lights that may be moved and dimmed as any other.
 * Full resolution needs nothing else; other looks are drawn by `render`.
 */
export class LearnedScene {
  readonly root: Group;
  /** Of the meshes, in the space of the root. */
  readonly bounds: Box3;
  readonly variables: readonly Variable[];
  readonly fields: readonly FieldProgram[];
  /** The declared lights in their order, then those that were added. */
  lamps: readonly Lamp[];
  private readonly options: LearnedSceneOptions;
  private readonly uniforms: SceneUniforms;
  private readonly placement: Placement;
  private readonly ownLights = new OwnLights();
  private readonly shadows = new ShadowKeeper();
  private readonly half = new HalfResolution();
  private readonly segments: FieldProgram | null;
  private readonly lightmaps: LoadedLight["lightmaps"];
  private readonly materials: SurfaceMaterials;
  private attached = false;
  private shown: Parts = { raster: true, indirect: true, still: true };
  /** What is drawn; `look` is what will be, once it is compiled. */
  private drawn: Look | "plain" = { half: false, segments: false };
  private look: Look = { half: false, segments: false };
  /** Counts compilations: one that was overtaken changes nothing. */
  private compilations = 0;

  constructor(gltf: GLTF, options: LearnedSceneOptions = {}) {
    const { variables, fields, lightmaps } = learnedLight(gltf);
    this.root = gltf.scene;
    this.options = options;
    OWNERS.get(this.root)?.detach();
    this.lightmaps = lightmaps;
    this.variables = variables;
    this.placement = new Placement(this.root);
    this.uniforms = { lightwellRaster: { value: 1 }, lightwellToRoot: { value: this.placement.toRoot } };
    this.bounds = boundsOf(this.root);
    this.lamps = variables.map((variable) => createLamp(variable, this.bounds, this.placement));
    const limit = inlineLimit(options.renderer);
    const print = (record: FieldRecord, name: string, outputs: readonly string[]) =>
      new FieldProgram(
        record,
        name,
        outputs,
        options.weights ?? (record.graph.macs <= limit ? "inline" : "texture"),
        Math.floor(FRAME_UNIFORM_LIMIT / fields.length),
      );
    this.fields = fields.map((record, i) => print(record, `lightwellField${i}`, ["radiance"]));
    const segmented = fields.find((record) => record.graph.outputs.has("segment"));
    this.segments = segmented ? print(segmented, "lightwellSegment", SEGMENT_OUTPUTS) : null;
    this.materials = this.createMaterials(`${scenes++}`);
    this.followLamps();
    this.checkBudget(options.renderer);
    this.attach();
  }

  /**
   * Light the root, as the constructor does; after `detach` or `dispose` again. A root that another `LearnedScene` lights is
   * taken over from it.
   */
  attach(): void {
    if (this.attached) return;
    OWNERS.get(this.root)?.detach();
    OWNERS.set(this.root, this);
    this.attached = true;
    if (this.fields.length > 0 || this.variables.length > 0) this.ownLights.remove(this.root);
    for (const lamp of this.lamps) lamp.attach();
    this.materials.attach(this.root);
  }

  /** Give the root back as it was loaded: its materials, its own lights. It stays where it is. */
  detach(): void {
    if (!this.attached) return;
    this.attached = false;
    this.compilations++;
    OWNERS.delete(this.root);
    for (const lamp of this.lamps) lamp.detach();
    this.materials.detach();
    this.ownLights.restore();
  }

  /** Whether any field is the light of the scene's own emitters. */
  get hasStillLight(): boolean {
    return this.fields.some((field) => field.record.role === "static");
  }

  /** Whether any field follows a declared light. */
  get hasIndirectLight(): boolean {
    return this.fields.some((field) => field.record.role === "indirect");
  }

  /** Whether any field says which expert shades a point. */
  get hasSegments(): boolean {
    return this.segments !== null;
  }

  /** Whether the file also carries ordinary light maps. */
  get hasLightmaps(): boolean {
    return this.lightmaps.size > 0;
  }

  /** What is stored as pictures: the features of the fields, then ordinary light maps. */
  get pictures(): readonly { readonly name: string; readonly texture: Texture; readonly bytes: number }[] {
    const features = this.fields.flatMap(({ record }) =>
      [...record.buffers].flatMap(([name, { picture }]) =>
        picture ? [{ name, texture: picture.source as Texture, bytes: picture.bytes }] : [],
      ),
    );
    const maps = new Map([...this.lightmaps.values()].map(({ map, bytes }) => [map, bytes]));
    const ordinary = [...maps].map(([texture, bytes]) => ({ name: "light map", texture, bytes }));
    return [...features, ...ordinary];
  }

  /** Whether the segmentation is drawn now. */
  get showsSegments(): boolean {
    return this.drawn !== "plain" && this.drawn.segments;
  }

  /** Multiply-adds per pixel of all fields and lamps. */
  get macs(): number {
    const sum = this.fields.reduce((total, field) => total + field.macs, 0);
    return this.look.half ? sum / 4 : sum;
  }

  /** Choose which parts of the light are shown. */
  show(parts: Parts): void {
    this.shown = parts;
    this.uniforms.lightwellRaster.value = parts.raster ? 1 : 0;
    this.materials.brighten(parts.still ? 1 : 0);
    this.tint();
  }

  /** Carry the lamps' colours and intensities over to the shaders. */
  tint(): void {
    for (const lamp of this.lamps) lamp.tint();
    for (const field of this.fields) {
      const lamps = this.lampsOf(field);
      lamps.forEach(({ color, intensity }, i) => {
        const gain = this.shown.indirect ? intensity : 0;
        field.setGain(i, new Vector3(color.r, color.g, color.b).multiplyScalar(gain));
      });
      if (lamps.length === 0) field.setGain(0, new Vector3().setScalar(this.isOn(field) ? 1 : 0));
    }
  }

  /**
   * Follow the root, the lamps and the materials, and bring the fields up to date; call before drawing. Throws when the root is
   * scaled unevenly.
   */
  update(renderer = this.options.renderer): void {
    if (!this.attached) return;
    if (this.placement.follow()) for (const lamp of this.lamps) lamp.renewShadow();
    for (const lamp of this.lamps) lamp.follow();
    this.shadows.ask(this.lamps, renderer ?? this);
    this.tint();
    this.materials.show("learned");
    for (const field of this.fields) field.update();
    this.segments?.update();
  }

  /**
   * Add a lamp of the kind of a declared light, where there is room; null when there are enough. Direct light alone is
   * drawn until `compile` has run, because shaders depend on the number of lights.
   */
  addLamp(variable = 0): Lamp | null {
    const declared = this.variables[variable];
    if (!declared || this.lamps.length >= MAX_LAMPS) return null;
    const lamp = createLamp(declared, this.bounds, this.placement);
    const alike = this.lamps.filter((other) => other.variable === declared);
    lamp.move(roomiestPlace(lamp, alike));
    lamp.intensity *= ADDED_SHARE;
    lamp.color.copy(tintOf(new Color(...declared.color), alike.length));
    if (this.attached) lamp.attach();
    this.setLamps([...this.lamps, lamp]);
    return lamp;
  }

  /** Take an added lamp away; returns whether there was one of this number. Then as for `addLamp`. */
  removeLamp(index: number): boolean {
    const lamp = this.lamps[index];
    if (!lamp || index < this.variables.length) return false;
    lamp.dispose();
    this.setLamps(this.lamps.filter((other) => other !== lamp));
    return true;
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
    const compilation = ++this.compilations;
    this.checkBudget(renderer);
    // Without this extension nobody can tell when the shaders are ready: the next frame waits for them.
    if (renderer.extensions.has("KHR_parallel_shader_compile")) {
      // The compilation of all that is worn starts at once; only the waiting is asynchronous.
      const compiled = looksOf(wanted).map((shown) => {
        this.materials.show(shown);
        return renderer.compileAsync(shown === "indirect" ? this.root : scene, camera);
      });
      this.materials.show("learned");
      await Promise.all(compiled);
    }
    if (compilation === this.compilations) this.drawn = wanted;
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
      else
        this.half.render(renderer, camera, width, height, () =>
          renderer.render(this.root as unknown as Scene, camera),
        );
    }
    // Between frames, meshes have the materials of their owner.
    this.materials.show("learned");
  }

  /** Draw `scene` with ordinary light maps in place of the learned light; only where `hasLightmaps`. */
  renderLightmap(renderer: WebGLRenderer, scene: Scene, camera: Camera): void {
    this.materials.show("lightmap");
    renderer.render(scene, camera);
    this.materials.show("learned");
  }

  /**
   * Give the root back as it was loaded, and free what GPUs hold of it. The root stays where it is; what is used again is
   * uploaded again, and `attach` lights it again.
   */
  dispose({ textures = true }: DisposeOptions = {}): void {
    for (const lamp of this.lamps) lamp.dispose();
    for (const field of this.fields) field.dispose();
    this.segments?.dispose();
    this.half.dispose();
    if (!this.attached) return;
    this.materials.dispose(textures);
    this.detach();
  }

  private createMaterials(id: string): SurfaceMaterials {
    const { fields, half, uniforms, segments } = this;
    const keep = this.options.environment === "keep" || fields.length === 0;
    const plain = learnedFinish("plain", [], uniforms, keep);
    const lightmap = this.hasLightmaps ? { lightmap: plain } : {};
    if (fields.length === 0) return new SurfaceMaterials({ plain, ...lightmap }, this.lightmaps);
    const finishes = {
      plain,
      ...lightmap,
      learned: learnedFinish(`learned${id}`, fields, uniforms, keep),
      indirect: indirectFinish(`indirect${id}`, fields, uniforms),
      upsampled: upsampledFinish(half, uniforms, keep),
      ...(segments ? { segments: segmentFinish(`segments${id}`, segments, uniforms) } : {}),
    };
    return new SurfaceMaterials(finishes, this.lightmaps);
  }

  /** Throws a `FormatError` when the materials ask for more than there is. */
  private checkBudget(renderer: WebGLRenderer | undefined): void {
    const demands = this.fields.map((field) => field.demand);
    checkMaterials(this.root, demands, this.lamps.length, renderer?.capabilities);
  }

  private setLamps(lamps: readonly Lamp[]): void {
    this.lamps = lamps;
    this.followLamps();
    this.materials.renew();
    this.drawn = "plain";
  }

  /** Tell every field which lamps it is evaluated for. */
  private followLamps(): void {
    const still = [new Vector3()];
    for (const field of [...this.fields, ...(this.segments ? [this.segments] : [])]) {
      const lights = this.lampsOf(field).map((lamp) => lamp.value);
      field.follow(lights.length > 0 ? lights : still);
    }
    this.show(this.shown);
  }

  private lampsOf(field: FieldProgram): Lamp[] {
    const variable = this.variables[field.record.variable];
    return this.lamps.filter((lamp) => lamp.variable === variable);
  }

  /** Whether a field that follows no lamp is shown. */
  private isOn(field: FieldProgram): boolean {
    return field.record.role === "static" ? this.shown.still : this.shown.indirect;
  }
}

/** What is shown, one after the other, to draw a look. */
function looksOf({ half, segments }: Look): readonly SurfaceLook[] {
  if (segments) return ["segments"];
  return half ? ["indirect", "upsampled"] : ["learned"];
}
