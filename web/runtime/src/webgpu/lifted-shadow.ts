/** The shadow of a declared light for `WebGPURenderer`: `shadow-lift.ts` in nodes. */

import { type DirectionalLight, DoubleSide, type Material, type PointLight } from "three";
import { lightPosition, lightShadowMatrix, lightTargetPosition, pointShadow, positionWorld, reference, shadow, vec4 } from "three/tsl";
import { COARSE, SHADOW_RADIUS, STRICT } from "../shadow-lift.ts";
import type { AnyNode } from "./field-nodes.ts";
import { coveredPosition } from "./surface-position.ts";

/** Smallest sine of the angle between ray and facet that counts. */
const LEAST_SINE = 0.25;

/** What three.js draws one object of a shadow map with. */
type DrawObject = (object: unknown, scene: unknown, camera: unknown, geometry: unknown, material: Material, ...rest: unknown[]) => void;

/**
 * A shadow that is tested at points lifted off their facets, and that both sides of every surface cast: a path tracer sees both as
 * blockers. It has a map of its own.
 */
export function liftedShadow(light: PointLight | DirectionalLight): AnyNode {
  const isPoint = (light as PointLight).isPointLight === true;
  const node: AnyNode = isPoint ? pointShadow(light as PointLight) : shadow(light);
  const [coordinate, filter, draw] = [node.setupShadowCoord, node.setupShadowFilter, node.renderShadow];
  node.setupShadowCoord = (builder: unknown) => {
    const lifted = (coveredPosition() as AnyNode).add(isPoint ? liftOfPoint(light as PointLight) : liftOfSun(light as DirectionalLight));
    return coordinate.call(node, builder, (lightShadowMatrix(light) as AnyNode).mul((vec4 as AnyNode)(lifted, 1)));
  };
  if (!isPoint) node.setupShadowFilter = (...given: unknown[]) => filter.call(node, ...given).sub(1).mul(edgeOf(texelOfSun(light as DirectionalLight))).add(1).max(0);
  node.renderShadow = (frame: AnyNode) => {
    const { renderer } = frame;
    const drawObject = renderer.getRenderObjectFunction() as DrawObject;
    renderer.setRenderObjectFunction(((object, scene, camera, geometry, material, ...rest) => {
      const { shadowSide } = material;
      material.shadowSide = DoubleSide;
      drawObject(object, scene, camera, geometry, material, ...rest);
      material.shadowSide = shadowSide;
    }) satisfies DrawObject);
    draw.call(node, frame);
    renderer.setRenderObjectFunction(drawObject);
  };
  return node;
}

function liftOfPoint(light: PointLight): AnyNode {
  const toLight = (lightPosition(light) as AnyNode).sub(coveredPosition());
  const reach = toLight.abs();
  const texel = reach.x.max(reach.y).max(reach.z).mul(2).div(sizeOf(light));
  const facet = facetOf();
  return lift(facet.mul(facet.dot(toLight).sign()), toLight, texel, 0.5);
}

function liftOfSun(light: DirectionalLight): AnyNode {
  const texel = texelOfSun(light);
  return lift(facetOf(), (lightPosition(light) as AnyNode).sub(lightTargetPosition(light)), texel, edgeOf(texel).sub(STRICT).div(2 - 2 * STRICT));
}

function texelOfSun(light: DirectionalLight): AnyNode {
  const across = (lightShadowMatrix(light) as AnyNode).transpose().element(0).xyz.length();
  return across.mul(sizeOf(light)).reciprocal();
}

function edgeOf(texel: AnyNode): AnyNode {
  return texel.reciprocal().mul(COARSE).clamp(1, STRICT);
}

/** Normal of the triangle on the side of the eye. */
function facetOf(): AnyNode {
  const world = positionWorld as AnyNode;
  return world.dFdx().cross(world.dFdy()).normalize();
}

/** From a point to where its shadow is tested; `texel` is one of the shadow map in world units there, `along` how many go to the light. */
function lift(facet: AnyNode, toLight: AnyNode, texel: AnyNode, along: AnyNode | number): AnyNode {
  const ray = toLight.normalize();
  const sine = facet.cross(ray).length().max(LEAST_SINE);
  return facet.mul(sine).mul(SHADOW_RADIUS + 1).add(ray.mul(along)).mul(texel);
}

function sizeOf(light: PointLight | DirectionalLight): AnyNode {
  return (reference as AnyNode)("mapSize", "vec2", light.shadow).x;
}
