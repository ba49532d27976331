/** A glTF scene with learned light for three.js' `WebGPURenderer`. */

import { Box3, type Group, type Material, Mesh, MeshStandardMaterial } from "three";
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
  uv,
} from "three/tsl";
import { MeshPhysicalNodeMaterial } from "three/webgpu";
import type { WeightPlacement } from "../field-program.ts";
import { createLamp, type Lamp } from "../lamp.ts";
import { learnedLight } from "../loader.ts";
import { removeLights } from "../own-lights.ts";
import type { Variable } from "../variables.ts";
import { type AnyNode, FieldNodes, type SurfaceNodes } from "./field-nodes.ts";

/** Up to this many multiply-adds a pixel, weights become literals of the shader. */
const INLINE_LIMIT = 4096;
/** Reflectance: base colour + 0.04 (1 − metallic), at least this (format/FORMAT.md). */
const [DIELECTRIC_F0, MIN_REFLECTANCE] = [0.04, 1e-3];

/** Options of a `LearnedNodeScene`. */
export interface LearnedNodeSceneOptions {
  /** Where weights live; by default small fields are literals and large ones textures. */
  readonly weights?: WeightPlacement;
}

/**
 * As `LearnedScene`, for `WebGPURenderer`: owns the scene graph of a loaded file, its declared lamps and its fields.
 *
 * Direct light is that of three.js' own surface model, whose coat is a little different from the path tracer's.
 * Add `root` to a scene, call `update` before each frame and `dispose` at the end.
 */
export class LearnedNodeScene {
  readonly root: Group;
  readonly bounds: Box3;
  readonly variables: readonly Variable[];
  readonly lamps: readonly Lamp[];
  readonly fields: readonly FieldNodes[];
  private readonly materials: readonly Material[];
  private readonly originals: readonly { mesh: Mesh; material: Mesh["material"] }[];

  constructor(gltf: GLTF, options: LearnedNodeSceneOptions = {}) {
    const { variables, fields } = learnedLight(gltf);
    this.root = gltf.scene;
    this.variables = variables;
    this.bounds = new Box3().setFromObject(this.root);
    if (fields.length > 0 || variables.length > 0) removeLights(this.root);
    this.lamps = variables.map((variable) => createLamp(variable, this.bounds));
    for (const lamp of this.lamps) this.root.add(lamp.object);
    this.fields = fields.map((record, i) => {
      const placement = options.weights ?? (record.graph.macs <= INLINE_LIMIT ? "inline" : "texture");
      const followed = this.lamps.filter((lamp) => lamp.variable === variables[record.variable]);
      return new FieldNodes(record, `lightwellField${i}`, followed, placement);
    });
    const meshes: Mesh[] = [];
    this.root.traverse((object) => {
      if (object instanceof Mesh) meshes.push(object);
    });
    this.originals = meshes.map((mesh) => ({ mesh, material: mesh.material }));
    const twins = new Map<Material, Material>();
    for (const mesh of meshes) {
      mesh.castShadow = mesh.receiveShadow = true;
      const worn = [mesh.material].flat().map((material) => this.twinOf(material, twins));
      mesh.material = Array.isArray(mesh.material) ? worn : worn[0]!;
    }
    this.materials = [...twins.values()];
  }

  /** Follow the lamps; call before drawing. */
  update(): void {
    for (const lamp of this.lamps) lamp.tint();
    for (const field of this.fields) field.update();
  }

  dispose(): void {
    for (const lamp of this.lamps) lamp.dispose();
    for (const field of this.fields) field.dispose();
    for (const material of this.materials) material.dispose();
    for (const { mesh, material } of this.originals) {
      mesh.material = material;
      mesh.geometry.dispose();
      for (const original of [material].flat()) disposeMaps(original);
    }
    this.root.removeFromParent();
  }

  private twinOf(material: Material, twins: Map<Material, Material>): Material {
    if (!(material instanceof MeshStandardMaterial)) return material;
    const found = twins.get(material);
    if (found) return found;
    const twin = new MeshPhysicalNodeMaterial();
    // As three.js itself turns a material into one of nodes: by name, getters included.
    for (const key in material) (twin as AnyNode)[key] = (material as AnyNode)[key];
    if (this.fields.length > 0) twin.emissiveNode = learnedEmission(this.fields);
    twins.set(material, twin);
    return twin;
  }
}

/** The material's emission plus reflectance times the learned radiance. */
function learnedEmission(fields: readonly FieldNodes[]): AnyNode {
  const metallic = materialMetalness as AnyNode;
  const reflectance = (diffuseColor as AnyNode).rgb.add(metallic.oneMinus().mul(DIELECTRIC_F0)).max(MIN_REFLECTANCE);
  const surface = surfaceNodes(reflectance, fields);
  const sum = fields.map((field) => field.radiance(surface)).reduce((a, b) => a.add(b));
  return (materialEmissive as AnyNode).add(reflectance.mul(sum));
}

function surfaceNodes(reflectance: AnyNode, fields: readonly FieldNodes[]): SurfaceNodes {
  const reads = (name: string) => fields.some((field) => field.graph.inputs.has(name));
  const position = positionWorld as AnyNode;
  const view = (cameraPosition as AnyNode).sub(position).normalize();
  const smooth = (normalWorldGeometry as AnyNode).normalize();
  // The side is that of the triangle: it must not switch inside a triangle at the silhouette.
  const facet = position.dFdx().cross(position.dFdy());
  const agrees = facet.dot(view).lessThan(0).equal(facet.dot(smooth).lessThan(0));
  const normal = (select as AnyNode)(agrees, smooth, smooth.negate());
  const bent = (normalWorld as AnyNode).normalize();
  return {
    position,
    view,
    normal,
    reflectance,
    roughness: materialRoughness,
    metallic: materialMetalness,
    ...(reads("shading_normal") ? { shading_normal: bent.sub(normal.mul(bent.dot(normal).min(0).mul(2))) } : {}),
    ...(reads("uv") ? { uv: uv(0) } : {}),
    ...(reads("uv1") ? { uv1: uv(1) } : {}),
  };
}

function disposeMaps(material: Material): void {
  for (const value of Object.values(material)) {
    if ((value as { isTexture?: boolean } | null)?.isTexture) (value as { dispose(): void }).dispose();
  }
  material.dispose();
}
