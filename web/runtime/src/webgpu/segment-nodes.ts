/** The picture of a field's segmentation in nodes: `segments.ts` for `WebGPURenderer`. */

import { float, mix, screenCoordinate, screenSize, select, vec3 } from "three/tsl";
import { linearOf, SEGMENT_COLORS, STRIPE_PERIOD } from "../segment-colors.ts";
import type { AnyNode, FieldNodes, SurfaceNodes } from "./field-nodes.ts";

const number = float as AnyNode;
const vector = vec3 as AnyNode;

/** Colours by number: the fixed ones, then hues a golden angle apart in OKLCH (Ottosson 2020) with three lightnesses. */
function swatch(segment: AnyNode): AnyNode {
  const i = segment.max(0).add(0.5).floor();
  const hue = i.mul(0.6180339887).fract().mul(2 * Math.PI);
  const lightness = i.mod(3).mul(0.1).add(0.6);
  const [a, b] = [hue.cos().mul(0.125), hue.sin().mul(0.125)];
  const root = vector(0.3963377774, -0.1055613458, -0.0894841775).mul(a).add(vector(0.2158037573, -0.0638541728, -1.291485548).mul(b)).add(lightness);
  const lms = root.mul(root).mul(root);
  const golden = vector(4.0767416621, -1.2684380046, -0.0041960863)
    .mul(lms.x)
    .add(vector(-3.3077115913, 2.6097574011, -0.7034186147).mul(lms.y))
    .add(vector(0.2309699292, -0.3413193965, 1.707614701).mul(lms.z))
    .max(0);
  return SEGMENT_COLORS.reduceRight((otherwise, color, k) => (select as AnyNode)(i.lessThan(k + 0.5), vector(...linearOf(color)), otherwise), golden);
}

/** Stripes of the second colour, as wide as its share; `lower`: whether the first segment has the lower number. */
function stripes(share: AnyNode, lower: AnyNode): AnyNode {
  const [at, size] = [screenCoordinate as AnyNode, screenSize as AnyNode];
  // From the lower edge, as WebGLRenderer counts.
  const phase = at.x.add(size.y.sub(at.y)).div(STRIPE_PERIOD).fract();
  const middle = (select as AnyNode)(lower, share.mul(0.5), share.mul(-0.5).add(1));
  const away = phase.sub(middle).add(0.5).fract().sub(0.5).abs();
  return share.mul(0.5).sub(away).mul(STRIPE_PERIOD / 1.5).add(0.5).clamp().mul(share.div(0.04).min(1));
}

/** Paints by segment, lit a little by the normal so that shapes can be read. The value is for the screen as it is. */
export function segmentNode(field: FieldNodes, surface: SurfaceNodes): AnyNode {
  const found = field.values(surface);
  const [segment, share, second] = [found.x, found.y, found.z];
  const color = swatch(segment);
  const other = (select as AnyNode)(second.lessThan(0), color.mul(0.3), swatch(second));
  const mixed = (mix as AnyNode)(color, other, stripes(share, segment.lessThan(second)));
  const sky = surface.normal.dot(vector(0.37, 0.83, 0.41)).mul(0.5).add(0.5);
  return mixed.mul(sky.mul(0.58).add(surface.normal.dot(surface.view).max(0).mul(0.12)).add(number(0.3)));
}
