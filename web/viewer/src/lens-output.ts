/** The last pass of the lens' canvas in nodes of three.js: `output-shader.ts` for a picture with coverage. */

import type { Texture } from "three";
import {
  acesFilmicToneMapping,
  agxToneMapping,
  float,
  linearToneMapping,
  mix,
  neutralToneMapping,
  screenCoordinate,
  screenUV,
  select,
  smoothstep,
  sRGBTransferOETF,
  texture,
  uniform,
  vec2,
  vec3,
  vec4,
} from "three/tsl";
import { NodeMaterial } from "three/webgpu";
import type { ToneMappingName } from "./tone-mapping.ts";

/** A node of unknown type: three.js types the operators of a node by its type alone. */
type AnyNode = any;

const TONE_MAPPINGS: Record<ToneMappingName, AnyNode> = {
  agx: agxToneMapping,
  aces: acesFilmicToneMapping,
  neutral: neutralToneMapping,
  none: linearToneMapping,
};
/** Largest radiance that tone curves are given. */
const MOST = 65_000;

/** Pictures of linear light, premultiplied by the coverage in the first channel of another. */
export interface OutputPictures {
  readonly picture: Texture;
  /** To the left in split mode. */
  readonly beside: Texture;
  readonly coverage: Texture;
}

/** Shows them before the page's backdrop. */
export class LensOutput {
  readonly material = new NodeMaterial();
  private readonly exposure = uniform(1);
  private readonly dither: AnyNode;
  private readonly split = uniform(0);
  private readonly pictures: OutputPictures;
  private toneMapping: ToneMappingName | null = null;

  constructor(pictures: OutputPictures, dither: boolean) {
    this.pictures = pictures;
    this.dither = float(dither ? 1 : 0);
    this.material.depthTest = this.material.depthWrite = false;
  }

  /** Set what the next frame is shown with; `split`: where the picture to the left ends, 0 to 1. */
  set(exposure: number, split: number, toneMapping: ToneMappingName): void {
    this.exposure.value = exposure;
    this.split.value = split;
    if (toneMapping === this.toneMapping) return;
    this.toneMapping = toneMapping;
    this.material.fragmentNode = this.nodeFor(toneMapping);
    this.material.needsUpdate = true;
  }

  dispose(): void {
    this.material.dispose();
  }

  private nodeFor(toneMapping: ToneMappingName): AnyNode {
    const at = screenUV as AnyNode;
    const { picture, beside, coverage: covered } = this.pictures;
    const coverage = (texture as AnyNode)(covered, at).x.clamp();
    const isBeside = at.x.lessThan(this.split);
    const light = (select as AnyNode)(isBeside, (texture as AnyNode)(beside, at), (texture as AnyNode)(picture, at)).rgb;
    const radiance = light.div(coverage.max(1e-4)).clamp(0, MOST);
    const shown = (sRGBTransferOETF as AnyNode)(TONE_MAPPINGS[toneMapping](radiance, this.exposure).clamp());
    const noise = gradientNoise(screenCoordinate).sub(0.5).div(255).mul(this.dither);
    return (vec4 as AnyNode)((mix as AnyNode)(backdrop(at), shown, coverage).add(noise), 1);
  }
}

/** What is behind the scene; rows count from the top here. */
function backdrop(at: AnyNode): AnyNode {
  const away = at.sub((vec2 as AnyNode)(0.5, 0.45)).mul((vec2 as AnyNode)(1.1, 1)).length();
  return (mix as AnyNode)((vec3 as AnyNode)(0.105, 0.108, 0.12), (vec3 as AnyNode)(0.032, 0.033, 0.038), (smoothstep as AnyNode)(0, 0.85, away));
}

function gradientNoise(at: AnyNode): AnyNode {
  return at.dot((vec2 as AnyNode)(0.06711056, 0.00583715)).fract().mul(52.9829189).fract();
}
