/** What a scene with learned light is for either renderer: its root, lamps, fields, and what is shown of them. */

import { type Box3, type Camera, Color, type Group, type Material, type Object3D, type Scene, type Texture, Vector3 } from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import { coreOf } from "./core.ts";
import type { Environment } from "./environment.ts";
import type { FieldRecord } from "./extension.ts";
import type { LampAnimation, LampClip, LampPlayer, PlayOptions } from "./lamp-clips.ts";
import { createLamp, type Lamp, ShadowKeeper, sunsWithSky } from "./lamp.ts";
import { turningOf } from "./turning-of.ts";
import type { LearnedField, WeightPlacement } from "./learned-field.ts";
import type { LitObjects, LitParts } from "./lit-objects.ts";
import { type Lightmap, type LoadedLight, learnedLight } from "./loaded-light.ts";
import { type Capabilities, checkMaterials, type Demand } from "./material-budget.ts";
import { ADDED_SHARE, roomiestPlace, tintOf } from "./more-lamps.ts";
import type { Mover } from "./movers.ts";
import { OwnLights } from "./own-lights.ts";
import { boundsOf, Placement } from "./placement.ts";
import { readClock, timeOfHour } from "./sky.ts";
import { type LampSetting, type LampSwitch, Switches } from "./switches.ts";
import type { SurfaceMaterials } from "./surface-materials.ts";
import type { Variable } from "./variables.ts";
import { MAX_LAMPS } from "./most.ts";

/** Which parts of the light are shown. */
export interface Parts {
  /** Direct light of the declared lights, and emission. */
  readonly raster: boolean;
  /** Learned light of the declared lights. */
  readonly indirect: boolean;
  /** Learned light of the scene's own emitters. */
  readonly still: boolean;
}

/** Options of a scene with learned light. */
export interface SceneOptions<R> {
  /** Where weights live; by default small fields are literals and large ones textures. */
  readonly weights?: WeightPlacement;
  /** What will draw the scene: its limits count. With several renderers, call `update` with each before it draws. */
  readonly renderer?: R;
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

/** A renderer as far as scenes draw with it themselves. */
export interface Drawing {
  render(scene: Object3D, camera: Camera): unknown;
}

/** The scene that a root is attached to: a root has one. */
const OWNERS = new WeakMap<Object3D, { detach(): void }>();

/**
 * Owns lamps and fields; an adapter prints the fields and puts them into the materials of its renderer. An adapter's constructor
 * ends with `begin`.
 */
export abstract class SceneCore<F extends LearnedField, R extends object> {
  readonly root: Group;
  /** Of the meshes, in the space of the root. */
  readonly bounds: Box3;
  /** The part of the bounds that is looked at: all of it, but for ground of kilometres and domes of sky. Lengths that suit the eye are shares of it. */
  readonly core: Box3;
  /** What surrounds the scene and stands still; null where nothing does. */
  readonly environment: Environment | null;
  readonly variables: readonly Variable[];
  /** Linear factor before tone mapping that suits the scene, for `renderer.toneMappingExposure`; null when the file says none. */
  readonly exposure: number | null;
  readonly fields: readonly F[];
  /** The declared lights in their order, then those that were added. */
  lamps: readonly Lamp[];
  /** Switches of the scene's own lamps, one a group; empty where their light cannot be changed. */
  readonly switches: readonly LampSwitch[];
  /** Nodes that move, with their values; empty where everything stands still. */
  readonly movers: readonly Mover[];
  private readonly ownLamps: Switches;
  private readonly player: LampPlayer | null;
  protected readonly options: SceneOptions<R>;
  protected readonly lightmaps: LoadedLight["lightmaps"];
  protected readonly placement: Placement;
  protected readonly shadows = new ShadowKeeper();
  protected abstract readonly materials: SurfaceMaterials;
  /** Counts what overtakes a compilation. */
  protected generation = 0;
  protected shown: Parts = { raster: true, indirect: true, still: true };
  private readonly ownLights = new OwnLights();
  private attached = false;
  private readonly probes: readonly FieldRecord[];
  /** What was added to be lit by the probes of the file. */
  protected lit: LitObjects<F> | null = null;

  /** `make`: prints a field, given its number and how many there are. */
  protected constructor(gltf: GLTF, options: SceneOptions<R>, make: (record: FieldRecord, index: number, count: number) => F) {
    const { variables, moving, playing, turning, lamps, fields, probes, lightmaps, exposure, core, environment, surrounding } = learnedLight(gltf);
    this.probes = probes;
    this.exposure = exposure;
    this.ownLamps = new Switches(lamps);
    this.switches = this.ownLamps.all;
    this.environment = environment && { radiance: environment.radiance, picture: surrounding, lamp: this.switches[environment.lamp ?? -1] ?? null };
    this.player = playing?.(this.switches) ?? null;
    this.root = gltf.scene;
    this.options = options;
    OWNERS.get(this.root)?.detach();
    this.lightmaps = lightmaps;
    this.variables = variables;
    this.placement = new Placement(this.root);
    this.bounds = boundsOf(this.root);
    this.core = coreOf(core, this.bounds);
    this.movers = moving?.(this.root, lightmaps as Map<Material, Lightmap>) ?? [];
    this.lamps = variables.map((variable) =>
      variable.kind === "environment" ? turning!(variable, this.root) : createLamp(variable, this.bounds, this.placement, this.core),
    );
    this.fields = fields.map((record, i) => make(record, i, fields.length));
  }

  /** What a field asks of a shader, and what there is; `renderer` is the one of the options or of a call. */
  protected abstract demands(renderer: R | undefined): { readonly fields: readonly Demand[]; readonly capabilities: Capabilities | undefined };
  /** Show the rasterised light or not. */
  protected abstract showRaster(on: boolean): void;
  /** The probes of the file, and what puts their light on materials. */
  protected abstract litParts(records: readonly FieldRecord[]): LitParts<F>;

  /** All that is evaluated for lamps: the fields, and what an adapter has beside them. */
  protected get programs(): readonly F[] {
    return this.fields;
  }

  /** The same, and the probes. */
  private get evaluated(): readonly F[] {
    return this.lit ? [...this.programs, ...this.lit.fields] : this.programs;
  }

  /** Light the root for the first time. Throws a `FormatError` when its materials would ask for too much. */
  protected begin(): void {
    this.followLamps();
    this.checkBudget(this.options.renderer);
    this.attach();
  }

  /**
   * Light the root, as the constructor does; after `detach` or `dispose` again. A root that another scene with learned light lights
   * is taken over from it. Where it throws, the root is as it was loaded.
   */
  attach(): void {
    if (this.attached) return;
    OWNERS.get(this.root)?.detach();
    OWNERS.set(this.root, this);
    this.attached = true;
    try {
      if (this.fields.length > 0 || this.variables.length > 0) this.ownLights.remove(this.root);
      for (const lamp of this.lamps) lamp.attach();
      this.ownLamps.attach(this.root, this.lightmaps as Map<Material, Lightmap>, this.ownLights.taken);
      this.materials.attach(this.root);
      this.lit?.attach();
    } catch (error) {
      this.detach();
      throw error;
    }
  }

  /** Give the root back as it was loaded: its materials, its own lights. It stays where it is. */
  detach(): void {
    if (!this.attached) return;
    this.attached = false;
    this.generation++;
    OWNERS.delete(this.root);
    for (const lamp of this.lamps) lamp.detach();
    this.materials.detach();
    this.lit?.detach();
    this.ownLamps.detach();
    for (const mover of this.movers) mover.restore();
    this.ownLights.restore();
  }

  /**
   * Give the root back as it was loaded, and free what GPUs hold of it, also after `detach`. The root stays where it is; what is used
   * again is uploaded again, and `attach` lights it again.
   */
  dispose({ textures = true }: DisposeOptions = {}): void {
    this.detach();
    for (const lamp of this.lamps) lamp.dispose();
    for (const field of this.evaluated) field.dispose();
    // A root that another scene lights by now is freed with that one.
    if (!OWNERS.has(this.root)) this.materials.dispose(textures);
  }

  /** Whether any field is the light of the scene's own emitters. */
  get hasStillLight(): boolean {
    return this.fields.some((field) => field.record.role === "static");
  }

  /** Whether any field follows a declared light. */
  get hasIndirectLight(): boolean {
    return this.fields.some((field) => field.record.role === "indirect");
  }

  /** Whether anything is seen behind the scene: a sky of its suns, or what surrounds it. `SkyBackground` draws it. */
  get hasSky(): boolean {
    return this.environment !== null || sunsWithSky(this.lamps).length > 0;
  }

  /** Whether the file has probes, which light what `addLit` is given. */
  get hasProbes(): boolean {
    return this.probes.length > 0;
  }

  /**
   * Light an object that is not of the file, and all below it, by the file's probes: a character, a thing that is carried about. It
   * hangs in your scene beside `root`, and may move; its materials are patched in place. Resolves when the next frame shows it lit;
   * rejects where the file has no probes.
   */
  async addLit(object: Object3D): Promise<void> {
    const { LitObjects } = await import("./lit-objects.ts");
    if (!this.lit) {
      this.lit = new LitObjects<F>(this.root, this.probes, (records) => this.litParts(records));
      this.followLamps();
    }
    this.lit.add(object);
    if (!this.attached) this.lit.detach();
  }

  /** Give an object that was added back as it was; returns whether it was lit. It stays where it is. */
  removeLit(object: Object3D): boolean {
    return this.lit?.remove(object) ?? false;
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

  /** Multiply-adds per pixel of all fields and lamps. */
  get macs(): number {
    return this.fields.reduce((total, field) => total + field.macs, 0);
  }

  /** Choose which parts of the light are shown. */
  show(parts: Parts): void {
    this.shown = parts;
    this.showRaster(parts.raster);
    this.materials.brighten(parts.still ? 1 : 0);
    this.tint();
  }

  /**
   * Dim, tint or switch one of the scene's own lamps: `setLamp("desk", 0.3)`, `setLamp("desk", { intensity: 1, color: "orange" })`.
   * Throws when the file has no lamp of this name.
   */
  setLamp(name: string, setting: LampSetting): void {
    this.ownLamps.set(name, setting);
  }

  /** Animations of the file that change its own lamps. */
  get animations(): readonly LampAnimation[] {
    return this.player?.clips ?? [];
  }

  /**
   * Start the animations of this name: `update` then sets the lamps, until `stopAnimation`. `loop: false` stays at the end. Throws when
   * the file has none of this name.
   */
  playAnimation(name: string, options?: PlayOptions): void {
    for (const clip of this.clipsOf(name)) this.player!.play(clip, options);
  }

  /** Stop the animations of this name; the lamps are as they were before. Throws as `playAnimation` does. */
  stopAnimation(name: string): void {
    for (const clip of this.clipsOf(name)) this.player!.stop(clip);
  }

  private clipsOf(name: string): readonly LampClip[] {
    const found = this.player?.clips.filter((clip) => clip.name === name) ?? [];
    if (found.length === 0) throw new Error(`LearnedScene: expected one of the animations ${this.animations.map((clip) => clip.name)}, found '${name}'`);
    return found;
  }

  /**
   * Move a node or clip of the file: `setMover("Door", 45)`, in degrees, metres or shares of the clip; values outside of its range are brought into it. Throws
   * when the file has no mover of this name.
   */
  setMover(name: string, value: number): void {
    const mover = this.movers.find((other) => other.name === name);
    if (!mover) throw new Error(`LearnedScene: expected one of the movers ${this.movers.map((other) => other.name)}, found '${name}'`);
    mover.value = value;
  }

  /**
   * Set the time of day of the suns that know one: `18:30`, or hours. Returns whether one is up then; where none is, nothing
   * changes.
   */
  setDay(clock: string | number): boolean {
    const hour = typeof clock === "number" ? clock : readClock(clock);
    const suns = sunsWithSky(this.lamps).map((sun) => [sun, hour === null ? null : timeOfHour(sun.variable.sky!, hour)] as const);
    for (const [sun, time] of suns) if (time !== null) sun.move(sun.arc.at(time, new Vector3()));
    return suns.some(([, time]) => time !== null);
  }

  /**
   * Turn the environment map, where it may turn: degrees clockwise seen from above. Returns whether it is turned so far; where it is
   * not, nothing changes.
   */
  setEnvironmentRotation(degrees: number): boolean {
    return turningOf(this.lamps)?.turn(degrees) ?? false;
  }

  /** The switch of an object under the root, such as one that a ray has met; null where it belongs to none. */
  switchOf(object: Object3D): LampSwitch | null {
    return this.ownLamps.of(object);
  }

  /** Carry the lamps' colours and intensities over to the shaders. */
  tint(): void {
    for (const lamp of this.lamps) lamp.tint();
    for (const field of this.lit ? [...this.fields, ...this.lit.fields] : this.fields) {
      const lamps = this.lampsOf(field);
      lamps.forEach(({ color, intensity, level }, i) => {
        const gain = this.shown.indirect ? intensity * level : 0;
        field.setGain(i, new Vector3(color.r, color.g, color.b).multiplyScalar(gain));
      });
      if (lamps.length === 0) field.setGain(0, new Vector3().setScalar(this.isOn(field) ? 1 : 0));
    }
  }

  /**
   * Follow the root, the lamps and the materials, and bring the fields up to date; call before drawing. Throws when the root is
   * scaled unevenly. Animations go on by `delta` seconds; by the clock unless it is given.
   */
  update(renderer: R | undefined = this.options.renderer, delta?: number): void {
    if (!this.attached) return;
    this.player?.advance(delta);
    // All of them follow; the shadows of whatever moved are drawn anew.
    const moved = [...this.movers.map((mover) => mover.follow(this.root)), this.lit?.moved()].includes(true);
    if (this.placement.follow() || moved) for (const lamp of this.lamps) lamp.renewShadow();
    for (const lamp of this.lamps) lamp.follow();
    this.shadows.ask(this.lamps, renderer ?? this);
    this.tint();
    this.materials.show("learned");
    this.lit?.show();
    this.ownLamps.follow();
    const poses = this.movers.map(({ pose }) => pose);
    for (const field of this.evaluated) field.update(this.ownLamps.factors, poses);
  }

  /**
   * Add a lamp of the kind of a declared light, where there is room; null when there are enough. Shaders depend on the number of
   * lights: call `compile`, or the next frame waits for them.
   */
  addLamp(variable = 0): Lamp | null {
    const declared = this.variables[variable];
    if (!declared || declared.kind === "environment" || this.lamps.length >= MAX_LAMPS) return null;
    const lamp = createLamp(declared, this.bounds, this.placement, this.core);
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

  /** Draw `scene` with ordinary light maps in place of the learned light; only where `hasLightmaps`. */
  renderLightmap(renderer: Drawing, scene: Scene, camera: Camera): void {
    this.materials.show("lightmap");
    renderer.render(scene, camera);
    this.materials.show("learned");
  }

  /** Throws a `FormatError` when the materials ask for more than there is. */
  protected checkBudget(renderer: R | undefined): void {
    const { fields, capabilities } = this.demands(renderer);
    checkMaterials(this.root, fields, this.lamps.length, capabilities);
  }

  /** The shaders for these lamps are other ones. */
  protected setLamps(lamps: readonly Lamp[]): void {
    this.lamps = lamps;
    this.followLamps();
    this.renew();
  }

  /** Compile everything anew when it is shown next. */
  protected renew(): void {
    this.materials.renew();
    this.lit?.renew();
  }

  /** Tell every field which lamps it is evaluated for. */
  private followLamps(): void {
    const still = [new Vector3()];
    for (const field of this.evaluated) {
      const lights = this.lampsOf(field).map((lamp) => lamp.value);
      field.follow(lights.length > 0 ? lights : still);
    }
    this.show(this.shown);
  }

  private lampsOf(field: LearnedField): Lamp[] {
    const variable = this.variables[field.record.variable];
    return this.lamps.filter((lamp) => lamp.variable === variable);
  }

  /** Whether a field that follows no lamp is shown. */
  private isOn(field: LearnedField): boolean {
    return field.record.role === "static" ? this.shown.still : this.shown.indirect;
  }
}
