/** A glTF scene with learned light for three.js' `WebGPURenderer`. */

import { type Box3, type Group, type Material, type Matrix4, Mesh, MeshStandardMaterial } from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import {
  cameraPosition,
  diffuseColor,
  materialEmissive,
  materialMetalness,
  materialRoughness,
  normalWorld,
  normalWorldGeometry,
  positionWorld,
  select,
  uniform,
  uv,
  vec4,
} from "three/tsl";
import { MeshPhysicalNodeMaterial } from "three/webgpu";
import type { WeightPlacement } from "../field-program.ts";
import { createLamp, type Lamp, ShadowKeeper } from "../lamp.ts";
import { learnedLight } from "../loader.ts";
import { checkMaterials } from "../material-budget.ts";
import { OwnLights } from "../own-lights.ts";
import { boundsOf, Placement } from "../placement.ts";
import type { Variable } from "../variables.ts";
import { capabilitiesOf, type DeviceOwner, takesWgsl } from "./device.ts";
import { type AnyNode, FieldNodes, type SurfaceNodes } from "./field-nodes.ts";

/** Up to this many multiply-adds a pixel, weights become literals of the shader. */
const INLINE_LIMIT = 4096;
/** Reflectance: base colour + 0.04 (1 − metallic), at least this (format/FORMAT.md). */
const [DIELECTRIC_F0, MIN_REFLECTANCE] = [0.04, 1e-3];

/** The scene that a root is attached to: a root has one. */
const OWNERS = new WeakMap<object, LearnedNodeScene>();

/** Options of a `LearnedNodeScene`. */
export interface LearnedNodeSceneOptions {
  /** Where weights live; by default small fields are literals and large ones textures. */
  readonly weights?: WeightPlacement;
  /** What will draw the scene: its device says how many textures a material may have. Without it, what every device offers. */
  readonly renderer?: DeviceOwner;
}

/**
 * As `LearnedScene`, for `WebGPURenderer`: owns the scene graph of a loaded file, its declared lamps and its fields.
 *
 * Direct light is that of three.js' own surface model, whose coat is a little different from the path tracer's.
 * Add `root` to a scene, call `update` before each frame and `dispose` at the end.
 */
export class LearnedNodeScene {
  readonly root: Group;
  /** Of the meshes, in the space of the root. */
  readonly bounds: Box3;
  readonly variables: readonly Variable[];
  readonly lamps: readonly Lamp[];
  readonly fields: readonly FieldNodes[];
  private readonly placement: Placement;
  private readonly shadows = new ShadowKeeper();
  private readonly ownLights = new OwnLights();
  private readonly twins = new Map<Material, Material>();
  private originals: readonly { mesh: Mesh; material: Mesh["material"]; castShadow: boolean; receiveShadow: boolean }[] = [];

  constructor(gltf: GLTF, options: LearnedNodeSceneOptions = {}) {
    const { variables, fields } = learnedLight(gltf);
    this.root = gltf.scene;
    this.variables = variables;
    this.bounds = boundsOf(this.root);
    this.placement = new Placement(this.root);
    this.lamps = variables.map((variable) => createLamp(variable, this.bounds, this.placement));
    this.fields = fields.map((record, i) => {
      const placement = options.weights ?? (record.graph.macs <= INLINE_LIMIT ? "inline" : "texture");
      const followed = this.lamps.filter((lamp) => lamp.variable === variables[record.variable]);
      return new FieldNodes(record, `lightwellField${i}`, followed, placement);
    });
    const demands = this.fields.map((field) => field.demand(takesWgsl(options.renderer)));
    checkMaterials(this.root, demands, this.lamps.length, capabilitiesOf(options.renderer));
    this.attach();
  }

  /** Light the root, as the constructor does; after `detach` or `dispose` again. */
  attach(): void {
    if (this.originals.length > 0) return;
    OWNERS.get(this.root)?.detach();
    OWNERS.set(this.root, this);
    if (this.fields.length > 0 || this.variables.length > 0) this.ownLights.remove(this.root);
    for (const lamp of this.lamps) lamp.attach();
    const meshes: Mesh[] = [];
    this.root.traverse((object) => {
      if (object instanceof Mesh) meshes.push(object);
    });
    this.originals = meshes.map((mesh) => ({ mesh, material: mesh.material, castShadow: mesh.castShadow, receiveShadow: mesh.receiveShadow }));
    for (const mesh of meshes) {
      mesh.castShadow = mesh.receiveShadow = true;
      const worn = [mesh.material].flat().map((material) => this.twinOf(material));
      mesh.material = Array.isArray(mesh.material) ? worn : worn[0]!;
    }
  }

  /** Give the root back as it was loaded: its materials, its own lights. It stays where it is. */
  detach(): void {
    OWNERS.delete(this.root);
    for (const lamp of this.lamps) lamp.detach();
    for (const { mesh, material, castShadow, receiveShadow } of this.originals) Object.assign(mesh, { material, castShadow, receiveShadow });
    for (const material of this.twins.values()) material.dispose();
    this.twins.clear();
    this.originals = [];
    this.ownLights.restore();
  }

  /** Follow the root, the lamps and the file's materials; call before drawing. Throws when the root is scaled unevenly. */
  update(renderer: object = this): void {
    if (this.placement.follow()) for (const lamp of this.lamps) lamp.renewShadow();
    for (const lamp of this.lamps) lamp.follow();
    this.shadows.ask(this.lamps, renderer);
    for (const [material, twin] of this.twins) if (twin !== material) followMaterial(material, twin);
    for (const field of this.fields) field.update();
  }

  /** Give the root back, and free what GPUs hold of it; textures of the model too unless that is `false`. */
  dispose({ textures = true }: { readonly textures?: boolean } = {}): void {
    for (const lamp of this.lamps) lamp.dispose();
    for (const field of this.fields) field.dispose();
    const { originals } = this;
    this.detach();
    for (const { mesh, material } of originals) {
      mesh.geometry.dispose();
      for (const original of [material].flat()) disposeMaps(original, textures);
    }
  }

  private twinOf(material: Material): Material {
    if (!(material instanceof MeshStandardMaterial)) return material;
    const found = this.twins.get(material);
    if (found) return found;
    const twin = new MeshPhysicalNodeMaterial();
    // As three.js itself turns a material into one of nodes: by name, getters included.
    for (const key in material) (twin as AnyNode)[key] = (material as AnyNode)[key];
    if (this.fields.length > 0) twin.emissiveNode = learnedEmission(this.fields, this.placement.toRoot);
    this.twins.set(material, twin);
    return twin;
  }
}

/** Carry edits of a material over to its twin of nodes; colours and vectors are the same objects. */
function followMaterial(material: Material, twin: Material): void {
  const [from, to] = [material as AnyNode, twin as AnyNode];
  for (const key of Object.keys(material)) {
    if (key === "uuid" || key === "version" || key.startsWith("_") || from[key] === to[key]) continue;
    const isValue = from[key] === null || typeof from[key] !== "object" || from[key].isTexture;
    if (!isValue) continue;
    if (typeof from[key] !== "number") twin.needsUpdate = true;
    to[key] = from[key];
  }
}

/** The material's emission plus reflectance times the learned radiance. */
function learnedEmission(fields: readonly FieldNodes[], toRoot: Matrix4): AnyNode {
  const metallic = materialMetalness as AnyNode;
  const reflectance = (diffuseColor as AnyNode).rgb.add(metallic.oneMinus().mul(DIELECTRIC_F0)).max(MIN_REFLECTANCE);
  const surface = surfaceNodes(reflectance, fields, toRoot);
  const sum = fields.map((field) => field.radiance(surface)).reduce((a, b) => a.add(b));
  return (materialEmissive as AnyNode).add(reflectance.mul(sum));
}

function surfaceNodes(reflectance: AnyNode, fields: readonly FieldNodes[], matrix: Matrix4): SurfaceNodes {
  const reads = (name: string) => fields.some((field) => field.graph.inputs.has(name));
  const position = positionWorld as AnyNode;
  const view = (cameraPosition as AnyNode).sub(position).normalize();
  const smooth = (normalWorldGeometry as AnyNode).normalize();
  // The side is that of the triangle: it must not switch inside a triangle at the silhouette.
  const facet = position.dFdx().cross(position.dFdy());
  const agrees = facet.dot(view).lessThan(0).equal(facet.dot(smooth).lessThan(0));
  const normal = (select as AnyNode)(agrees, smooth, smooth.negate());
  const bent = (normalWorld as AnyNode).normalize();
  // Fields were learned in the space of the root.
  const toRoot = (uniform as AnyNode)(matrix);
  const direction = (vector: AnyNode) => toRoot.mul((vec4 as AnyNode)(vector, 0)).xyz.normalize();
  return {
    position: toRoot.mul((vec4 as AnyNode)(position, 1)).xyz,
    view: direction(view),
    normal: direction(normal),
    reflectance,
    roughness: materialRoughness,
    metallic: materialMetalness,
    ...(reads("shading_normal") ? { shading_normal: direction(bent.sub(normal.mul(bent.dot(normal).min(0).mul(2)))) } : {}),
    ...(reads("uv") ? { uv: uv(0) } : {}),
    ...(reads("uv1") ? { uv1: uv(1) } : {}),
  };
}

function disposeMaps(material: Material, textures: boolean): void {
  for (const value of textures ? Object.values(material) : []) {
    if ((value as { isTexture?: boolean } | null)?.isTexture) (value as { dispose(): void }).dispose();
  }
  material.dispose();
}
