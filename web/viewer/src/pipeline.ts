/** Renders the scene to a high-dynamic-range picture and shows it on the canvas. */

import {
  BufferGeometry,
  ConstantAlphaFactor,
  CustomBlending,
  Float32BufferAttribute,
  GLSL3,
  HalfFloatType,
  LinearFilter,
  Mesh,
  NoBlending,
  OneMinusConstantAlphaFactor,
  OrthographicCamera,
  type PerspectiveCamera,
  type Scene,
  ShaderMaterial,
  type Texture,
  Vector4,
  type WebGLRenderer,
  WebGLRenderTarget,
} from "three";
import { OUTPUT_VERTEX, outputFragment, SHOW } from "./output-shader.ts";
import type { Stage } from "./stage.ts";
import type { ToneMappingName } from "./tone-mapping.ts";

/** Owns the render targets and the output pass. */
export class Pipeline {
  /** Learned picture, as large as the canvas. */
  readonly total: WebGLRenderTarget;
  /** Learned picture, as large as the reference. */
  readonly picture: WebGLRenderTarget;
  /** The scene with ordinary light maps, beside the learned picture. */
  readonly beside: WebGLRenderTarget;
  readonly uniforms = {
    total: { value: null as Texture | null },
    picture: { value: null as Texture | null },
    beside: { value: null as Texture | null },
    reference: { value: null as Texture | null },
    mean: { value: null as Texture | null },
    frame: { value: new Vector4(0, 0, 1, 1) },
    show: { value: 0 },
    split: { value: 0.5 },
    floorRadiance: { value: 1e-2 },
    dither: { value: 1 },
    toneMappingExposure: { value: 1 },
  };
  /**
   * One frame of such a mean. It has one sample of a pixel: the mean of several would be taken before the tone curve, so that a pixel
   * of which a lamp fills a quarter is as white as the lamp.
   */
  readonly single = createTarget(0);
  /** Mean of displayed frames. */
  private readonly mean = createTarget(0);
  private readonly renderer: WebGLRenderer;
  private readonly camera = new OrthographicCamera();
  private readonly triangle: Mesh<BufferGeometry, ShaderMaterial>;

  constructor(renderer: WebGLRenderer, samples: number) {
    this.renderer = renderer;
    this.total = createTarget(samples);
    this.picture = createTarget(samples);
    this.uniforms.total.value = this.total.texture;
    this.uniforms.picture.value = this.picture.texture;
    this.beside = createTarget(samples);
    this.uniforms.beside.value = this.beside.texture;
    this.uniforms.mean.value = this.mean.texture;
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new Float32BufferAttribute([-1, -1, 0, 3, -1, 0, -1, 3, 0], 3));
    geometry.setAttribute("uv", new Float32BufferAttribute([0, 0, 2, 0, 0, 2], 2));
    this.triangle = new Mesh(geometry, this.createMaterial("agx"));
    this.triangle.frustumCulled = false;
  }

  setToneMapping(name: ToneMappingName): void {
    this.triangle.material.dispose();
    this.triangle.material = this.createMaterial(name);
  }

  /** Render radiance into a target of this pipeline. */
  renderStage(
    target: WebGLRenderTarget,
    width: number,
    height: number,
    stage: Stage,
    camera: PerspectiveCamera,
  ): void {
    target.setSize(Math.max(1, Math.round(width)), Math.max(1, Math.round(height)));
    stage.render(target, camera);
  }

  /** As `renderStage`, with ordinary light maps in place of the learned light. */
  renderLightmap(
    target: WebGLRenderTarget,
    width: number,
    height: number,
    stage: Stage,
    camera: PerspectiveCamera,
  ): void {
    target.setSize(Math.max(1, Math.round(width)), Math.max(1, Math.round(height)));
    stage.renderLightmap(target, camera);
  }

  /** Show the pictures on the canvas, or in a target. */
  present(target: WebGLRenderTarget | null = null): void {
    this.renderer.setRenderTarget(target);
    this.renderer.render(this.triangle as unknown as Scene, this.camera);
    this.renderer.setRenderTarget(null);
  }

  /** Take what `present` would show, of `total` or `single`, into the mean of `count` such frames; the first one begins it. */
  gather(count: number): void {
    const { renderer, uniforms } = this;
    const { material } = this.triangle;
    const { dither } = uniforms;
    const { width, height } = renderer.domElement;
    const [dithered, { autoClear }] = [dither.value, renderer];
    this.mean.setSize(width, height);
    material.blending = CustomBlending;
    material.blendAlpha = 1 / count;
    dither.value = 0;
    // No shader may read what it writes.
    uniforms.mean.value = null;
    if (count > 1) uniforms.total.value = this.single.texture;
    renderer.autoClear = false;
    this.present(this.mean);
    renderer.autoClear = autoClear;
    uniforms.mean.value = this.mean.texture;
    uniforms.total.value = this.total.texture;
    dither.value = dithered;
    material.blending = NoBlending;
  }

  /** Show the mean on the canvas. */
  presentMean(): void {
    const { show } = this.uniforms;
    const shown = show.value;
    show.value = SHOW.mean;
    this.present();
    show.value = shown;
  }

  /** A reference, small, as it would look on the canvas. */
  thumbnail(reference: Texture, width: number, height: number, exposure: number): ImageData {
    const target = new WebGLRenderTarget(width, height);
    const { uniforms } = this;
    uniforms.reference.value = reference;
    uniforms.show.value = SHOW.reference;
    uniforms.frame.value.set(0, 1, 1, -1);
    uniforms.toneMappingExposure.value = exposure;
    this.present(target);
    const pixels = new Uint8Array(width * height * 4);
    this.renderer.readRenderTargetPixels(target, 0, 0, width, height, pixels);
    target.dispose();
    return new ImageData(new Uint8ClampedArray(pixels), width, height);
  }

  dispose(): void {
    this.total.dispose();
    this.picture.dispose();
    this.beside.dispose();
    this.single.dispose();
    this.mean.dispose();
    this.triangle.geometry.dispose();
    this.triangle.material.dispose();
  }

  private createMaterial(toneMapping: ToneMappingName): ShaderMaterial {
    return new ShaderMaterial({
      name: "output",
      glslVersion: GLSL3,
      uniforms: this.uniforms,
      vertexShader: OUTPUT_VERTEX,
      fragmentShader: outputFragment(toneMapping),
      toneMapped: false,
      depthTest: false,
      depthWrite: false,
      blending: NoBlending,
      blendSrc: ConstantAlphaFactor,
      blendDst: OneMinusConstantAlphaFactor,
    });
  }
}

function createTarget(samples: number): WebGLRenderTarget {
  return new WebGLRenderTarget(1, 1, {
    type: HalfFloatType,
    minFilter: LinearFilter,
    magFilter: LinearFilter,
    samples,
  });
}
