/** A glTF scene lit by its declared lights (rasterised) and by its learned fields. */

import {
  Box3,
  type Camera,
  DoubleSide,
  type Group,
  type IUniform,
  Light,
  type Material,
  Mesh,
  MeshStandardMaterial,
  Object3D,
  type Scene,
  Vector3,
  type WebGLRenderer,
} from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import { inlineLimit } from "./device.ts";
import { FieldProgram, type WeightPlacement } from "./field-program.ts";
import { createLamp, type Lamp } from "./lamp.ts";
import { learnedLight } from "./loader.ts";
import { addLearnedLight } from "./surface-shader.ts";

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
  /** What will draw the scene: on a rasteriser without a GPU, larger fields are literals. */
  readonly renderer?: WebGLRenderer;
}

/** The materials of a mesh, with and without learned light. */
interface Dress {
  readonly mesh: Mesh;
  readonly plain: Mesh["material"];
  readonly learned: Mesh["material"];
}

/** Scenes so far: their shaders differ, and so must their names. */
let scenes = 0;

/**
 * Owns the scene graph of a loaded file, its lamps and its fields.
 *
 * Add `root` to a three.js scene, render with shadow maps enabled, call `dispose` at the end.
 */
export class LearnedScene {
  readonly root: Group;
  readonly bounds: Box3;
  readonly lamps: readonly Lamp[];
  readonly fields: readonly FieldProgram[];
  private readonly raster: IUniform<number> = { value: 1 };
  private readonly dresses: readonly Dress[];
  private readonly id = scenes++;
  private disposed = false;
  private shown: Parts = { raster: true, indirect: true, still: true };

  constructor(gltf: GLTF, options: LearnedSceneOptions = {}) {
    const { variables, fields } = learnedLight(gltf);
    this.root = gltf.scene;
    this.bounds = new Box3().setFromObject(this.root);
    if (fields.length > 0 || variables.length > 0) removeLights(this.root);
    this.lamps = variables.map((variable) => createLamp(variable, this.bounds));
    for (const lamp of this.lamps) this.root.add(lamp.object);
    const still = new Vector3();
    const limit = inlineLimit(options.renderer);
    this.fields = fields.map((field, i) => {
      const weights = options.weights ?? (field.graph.macs <= limit ? "inline" : "texture");
      return new FieldProgram(field, i, this.lamps[field.variable]?.value ?? still, weights);
    });
    this.dresses = this.patchMaterials();
    this.useFields(true);
    this.show(this.shown);
  }

  /** Whether any field is the light of the scene's own emitters. */
  get hasStillLight(): boolean {
    return this.fields.some((field) => field.record.role === "static");
  }

  /** Whether any field follows a declared light. */
  get hasIndirectLight(): boolean {
    return this.fields.some((field) => field.record.role === "indirect");
  }

  /** Choose which parts of the light are shown. */
  show(parts: Parts): void {
    this.shown = parts;
    this.raster.value = parts.raster ? 1 : 0;
    this.tint();
  }

  /** Carry the lamps' colours and intensities over to the shaders. */
  tint(): void {
    for (const lamp of this.lamps) lamp.tint();
    for (const field of this.fields) {
      const gain = field.uniforms[field.gain]!.value as Vector3;
      const lamp = this.lamps[field.record.variable];
      if (lamp)
        gain
          .set(lamp.color.r, lamp.color.g, lamp.color.b)
          .multiplyScalar(this.shown.indirect ? lamp.intensity : 0);
      else gain.setScalar(this.shown.still ? 1 : 0);
    }
  }

  /** Bring the fields' per-frame parts up to date; call before drawing. */
  update(): void {
    for (const field of this.fields) field.update();
  }

  /**
   * Compile the fields' shaders without holding up the page: until this resolves, the scene is drawn with direct light
   * alone. The renderer must be set to the target that will be drawn into; `scene` holds `root` and all lights.
   */
  async compile(renderer: WebGLRenderer, scene: Scene, camera: Camera): Promise<void> {
    // Without this extension nobody can tell when the shaders are ready: the next frame waits for them.
    if (!renderer.extensions.has("KHR_parallel_shader_compile")) {
      this.useFields(true);
      return;
    }
    // The compilation of all that is worn starts at once; only the waiting is asynchronous.
    this.useFields(true);
    const compiled = renderer.compileAsync(scene, camera);
    this.useFields(false);
    await compiled;
    if (!this.disposed) this.useFields(true);
  }

  /** Draw with learned light, or with the shaders that have none: when its own fail or are not yet compiled. */
  useFields(on: boolean): void {
    for (const { mesh, plain, learned } of this.dresses) mesh.material = on ? learned : plain;
  }

  dispose(): void {
    this.disposed = true;
    for (const lamp of this.lamps) lamp.dispose();
    for (const field of this.fields) field.dispose();
    for (const { mesh, plain, learned } of this.dresses) {
      mesh.geometry.dispose();
      for (const material of [plain, learned].flat()) disposeMaterial(material);
    }
    this.root.removeFromParent();
  }

  private patchMaterials(): Dress[] {
    const uniforms = { lightwellRaster: this.raster };
    const plain = { fields: [], uniforms, key: "plain" };
    const learned = { fields: this.fields, uniforms, key: `${this.id}` };
    const twins = new Map<Material, Material>();
    /** The material with learned light; `material` itself when there is none to add. */
    const twinOf = (material: Material): Material => {
      let twin = twins.get(material);
      if (!twin) {
        // A path tracer sees both sides of a sheet as blockers; so must the shadow map.
        material.shadowSide = DoubleSide;
        const adds = this.fields.length > 0 && material instanceof MeshStandardMaterial;
        twin = adds ? material.clone() : material;
        if (material instanceof MeshStandardMaterial) addLearnedLight(material, plain);
        if (adds) addLearnedLight(twin as MeshStandardMaterial, learned);
        twins.set(material, twin);
      }
      return twin;
    };
    const dresses: Dress[] = [];
    this.root.traverse((mesh) => {
      if (!(mesh instanceof Mesh)) return;
      const worn: Mesh["material"] = mesh.material;
      mesh.receiveShadow = true;
      mesh.castShadow = [worn].flat().some(blocksLight);
      dresses.push({ mesh, plain: worn, learned: Array.isArray(worn) ? worn.map(twinOf) : twinOf(worn) });
    });
    return dresses;
  }
}

/** Blended and transmissive surfaces would cast solid shadows. */
function blocksLight(material: Material): boolean {
  const transmission = (material as { transmission?: number }).transmission ?? 0;
  return !material.transparent && transmission < 0.5;
}

/** The light of the file's own lights is in the static field, if anywhere; what hangs on them stays. */
function removeLights(root: Object3D): void {
  const lights: Object3D[] = [];
  root.traverse((object) => {
    if (object instanceof Light) lights.push(object);
  });
  for (const light of lights) {
    const node = new Object3D().copy(light, false);
    const children = light.children.filter((child) => child !== (light as { target?: Object3D }).target);
    if (children.length > 0) light.parent?.add(node.add(...children));
    light.removeFromParent();
  }
}

function disposeMaterial(material: Material): void {
  for (const value of Object.values(material)) {
    if (value && typeof value === "object" && (value as { isTexture?: boolean }).isTexture) {
      (value as { dispose(): void }).dispose();
    }
  }
  material.dispose();
}
