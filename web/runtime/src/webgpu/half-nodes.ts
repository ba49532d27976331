/** Learned light at half the width and height in nodes: `half-resolution.ts` for `WebGPURenderer`. */

import { cameraViewMatrix, float, Fn, If, ivec2, Loop, mrt, output, positionWorld, screenCoordinate, select, textureLoad, uniform, vec2, vec3, vec4 } from "three/tsl";
import { HalfTarget, LEAST_WEIGHT, NORMAL_COSINES, PLANE_SHARE } from "../half-target.ts";
import type { AnyNode, SurfaceNodes } from "./field-nodes.ts";
import { coveredPosition } from "./surface-position.ts";

/** Name of the target that holds normals and depths. */
const SURFACE = "lightwellSurface";
/** Disagreement with the void. */
const HUGE = 1e9;

const vector2 = vec2 as AnyNode;
const vector3 = vec3 as AnyNode;
const vector4 = vec4 as AnyNode;

/** From the eye to the surface along the axes of the camera. */
const seenPoint = (): AnyNode => (cameraViewMatrix as AnyNode).mul(vector4(coveredPosition(), 1)).xyz;

/** The small picture of `WebGPURenderer`. */
export class HalfNodes extends HalfTarget {
  /** What the targets are by themselves; materials fill them. */
  readonly targets: AnyNode = (mrt as AnyNode)({ output, [SURFACE]: vector4(0) });

  constructor() {
    super();
    [this.light.name, this.surface.name] = ["output", SURFACE];
  }
}

/** What a material of the small picture writes beside its light. */
export function smallTargets({ normal }: SurfaceNodes): AnyNode {
  return (mrt as AnyNode)({ [SURFACE]: vector4(normal, seenPoint().z.negate()) });
}

/**
 * The small picture's light at a surface: four taps around the pixel, which count as far as they lie on its tangent plane and face
 * as it does; where none agrees, the one of a wider neighbourhood that agrees best.
 */
export function upsampledNode(half: HalfNodes, surface: SurfaceNodes): AnyNode {
  const [scale, size, unproject] = [half.scale, half.size, half.unproject].map((value) => (uniform as AnyNode)(value));
  const read = (picture: unknown, tap: AnyNode) => (textureLoad as AnyNode)(picture, (ivec2 as AnyNode)(tap));
  return (Fn as AnyNode)(() => {
    const point = seenPoint().toVar();
    const world = positionWorld as AnyNode;
    const facet = world.dFdx().cross(world.dFdy()).normalize();
    const plane = (cameraViewMatrix as AnyNode).mul(vector4(facet, 0)).xyz.toVar();
    const normal = surface.normal.toVar();
    const at = (screenCoordinate as AnyNode).mul(scale).sub(0.5).toVar();
    const low = at.floor().toVar();
    const share = at.sub(low).toVar();
    // How little a tap agrees: the distance from the tangent plane in units of what counts, and 1 - cosine.
    const disagreement = (tap: AnyNode): AnyNode => {
      const found = read(half.surface, tap).toVar();
      const ndc = tap.add(0.5).div(size).mul(2).sub(1).mul(vector2(1, -1));
      const there = vector3(ndc.mul(unproject.xy).add(unproject.zw), -1).mul(found.w);
      const off = plane.dot(there.sub(point)).abs().div(point.z.mul(-PLANE_SHARE));
      const isVoid = found.xyz.dot(found.xyz).lessThan(0.25);
      return (select as AnyNode)(isVoid, vector2(HUGE), vector2(off, normal.dot(found.xyz).oneMinus())).toVar();
    };
    const inside = (tap: AnyNode): AnyNode => tap.clamp(vector2(0), size.sub(1)).toVar();
    const sum = vector4(0).toVar();
    for (const [x, y] of [[0, 0], [1, 0], [0, 1], [1, 1]] as const) {
      const tap = inside(low.add(vector2(x, y)));
      const off = disagreement(tap);
      const linear = (x ? share.x : share.x.oneMinus()).mul(y ? share.y : share.y.oneMinus());
      const faces = off.y.oneMinus().smoothstep(...NORMAL_COSINES);
      const weight = linear.mul(off.x.mul(off.x).oneMinus().max(0)).mul(faces);
      sum.addAssign(vector4(read(half.light, tap).rgb, 1).mul(weight));
    }
    const light = vector3(0).toVar();
    (If as AnyNode)(sum.w.greaterThan(LEAST_WEIGHT), () => {
      light.assign(sum.rgb.div(sum.w));
    }).Else(() => {
      const best = (float as AnyNode)(0.1 * HUGE).toVar();
      (Loop as AnyNode)(4, 4, ({ i, j }: AnyNode) => {
        const tap = inside(low.add(vector2((float as AnyNode)(i), (float as AnyNode)(j))).sub(1));
        const off = disagreement(tap);
        const worth = off.y.mul(10).add(off.x).toVar();
        (If as AnyNode)(worth.lessThan(best), () => {
          best.assign(worth);
          light.assign(read(half.light, tap).rgb);
        });
      });
    });
    return light;
  })();
}
