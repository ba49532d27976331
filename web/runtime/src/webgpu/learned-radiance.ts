/** `learnedRadiance`: the value of a field as a TSL node, for materials of one's own. */

import type { Matrix4 } from "three";
import {
  cameraPosition,
  cameraProjectionMatrix,
  cameraViewMatrix,
  diffuseColor,
  float,
  Fn,
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
import type { Node } from "three/webgpu";
import type { AnyNode, FieldNodes, SurfaceNodes } from "./field-nodes.ts";
import { coveredPosition } from "./surface-position.ts";

/** Reflectance: base colour + 0.04 (1 − metallic), at least this (format/FORMAT.md). */
const [DIELECTRIC_F0, MIN_REFLECTANCE] = [0.04, 1e-3];

/** What a field is told of the surface, in the space in which it was learned; what is left out is that of the mesh that is drawn. */
export interface RadianceInputs {
  /** Point, metres. */
  readonly position?: Node<"vec3">;
  /** Unit normal on the side of the eye, of the geometry. */
  readonly normal?: Node<"vec3">;
  /** The same with the normal map. */
  readonly shadingNormal?: Node<"vec3">;
  /** Unit direction to the eye. */
  readonly view?: Node<"vec3">;
  /** Base colour plus the reflectance of a dielectric. */
  readonly reflectance?: Node<"vec3">;
  /** From 0 to 1. */
  readonly roughness?: Node<"float">;
  readonly metallic?: Node<"float">;
  /** Texture coordinates of the first and second set. */
  readonly uv?: Node<"vec2">;
  readonly uv1?: Node<"vec2">;
  /** From the world to the space in which the field was learned, for what is left out; the world itself unless given. */
  readonly toRoot?: Matrix4;
}

/** Of what moves. */
interface Moved {
  /** From the place of the surface to where it rests, in the space of the root. */
  readonly toRest?: Matrix4;
}

/**
 * The light that a field has for a point of a surface, for all lamps that it follows: a node of linear RGB that is to be multiplied
 * by the reflectance.
 *
 * Args: the field, one of `scene.fields`; what it is told of the surface. Build the node again when lamps were added or removed.
 */
export function learnedRadiance(field: FieldNodes, inputs: RadianceInputs = {}): Node<"vec3"> {
  return field.radiance(surfaceNodes([field], inputs)) as Node<"vec3">;
}

/** Nodes of what fields read, those given and those of the mesh. */
export function surfaceNodes(fields: readonly FieldNodes[], { toRoot, toRest, shadingNormal, ...given }: RadianceInputs & Moved = {}): SurfaceNodes {
  const reads = (name: string) => fields.some((field) => field.graph.inputs.has(name));
  const world = positionWorld as AnyNode;
  const covered = coveredPosition();
  // The direction of a parallel camera, whose projection divides by 1, is that of all of its rays.
  const toCamera = (vec4 as AnyNode)(0, 0, 1, 0).mul(cameraViewMatrix).xyz;
  const isParallel = (cameraProjectionMatrix as AnyNode).element(3).w.equal(1);
  const view = (select as AnyNode)(isParallel, toCamera, (cameraPosition as AnyNode).sub(covered).normalize());
  const smooth = (normalWorldGeometry as AnyNode).normalize();
  // The side is that of the triangle: it must not switch inside a triangle at the silhouette.
  const facet = world.dFdx().cross(world.dFdy());
  const agrees = facet.dot(view).lessThan(0).equal(facet.dot(smooth).lessThan(0));
  const normal = (select as AnyNode)(agrees, smooth, smooth.negate());
  const bent = (normalWorld as AnyNode).normalize();
  const matrix = toRoot ? (uniform as AnyNode)(toRoot) : null;
  const direction = (vector: AnyNode) => (matrix ? matrix.mul((vec4 as AnyNode)(vector, 0)).xyz.normalize() : vector);
  const place = matrix ? matrix.mul((vec4 as AnyNode)(covered, 1)).xyz : covered;
  const facing = direction(normal);
  const rest = toRest ? (uniform as AnyNode)(toRest) : null;
  return {
    position: place,
    view: direction(view),
    normal: facing,
    ...(reads("rest_position") ? { rest_position: rest ? rest.mul((vec4 as AnyNode)(place, 1)).xyz : place } : {}),
    ...(reads("rest_normal") ? { rest_normal: rest ? rest.mul((vec4 as AnyNode)(facing, 0)).xyz.normalize() : facing } : {}),
    reflectance: reflectanceNode(),
    roughness: ownNode("roughnessNode", materialRoughness),
    metallic: metallicNode(),
    ...(reads("shading_normal") ? { shading_normal: direction(bent.sub(normal.mul(bent.dot(normal).min(0).mul(2)))) } : {}),
    ...(reads("uv") ? { uv: uv(0) } : {}),
    ...(reads("uv1") ? { uv1: uv(1) } : {}),
    ...(shadingNormal ? { shading_normal: shadingNormal } : {}),
    ...given,
  };
}

/** A property of the surface: a node that the material has for it counts before its number and its map. */
function ownNode(name: string, otherwise: AnyNode): AnyNode {
  return (Fn as AnyNode)(({ material }: AnyNode) => (float as AnyNode)(material[name] ?? otherwise), "float")();
}

const metallicNode = () => ownNode("metalnessNode", materialMetalness);

/** What learned light is multiplied by. */
export function reflectanceNode(): AnyNode {
  return (diffuseColor as AnyNode).rgb.add(metallicNode().oneMinus().mul(DIELECTRIC_F0)).max(MIN_REFLECTANCE);
}
