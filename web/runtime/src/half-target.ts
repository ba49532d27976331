/** The small picture of learned light at half the width and height, for both renderers. */

import {
  type Camera,
  HalfFloatType,
  NearestFilter,
  type Texture,
  Vector2,
  Vector4,
  WebGLRenderTarget,
} from "three";

/** A tap counts while it is nearer to the surface's tangent plane than this share of the distance to the eye. */
export const PLANE_SHARE = 0.005;
/** Cosines of the angle between normals from which a tap begins to count, and from which it counts fully. */
export const NORMAL_COSINES = [0.7, 0.95] as const;
/** A sum of weights below this is nothing: then the tap that agrees best is taken as it is. */
export const LEAST_WEIGHT = 1e-3;

/** Owns the small targets: demodulated radiance, and normal with depth along the view axis. */
export class HalfTarget {
  readonly target = new WebGLRenderTarget(1, 1, {
    count: 2,
    type: HalfFloatType,
    minFilter: NearestFilter,
    magFilter: NearestFilter,
  });
  /** Small texels per pixel of the full picture. */
  readonly scale = new Vector2();
  /** Texels of the small picture along x and y. */
  readonly size = new Vector2();
  /** View-space x and y over depth are ndc · xy + zw. */
  readonly unproject = new Vector4();

  /** Demodulated radiance. */
  get light(): Texture {
    return this.target.textures[0]!;
  }

  /** Normal, and depth along the view axis. */
  get surface(): Texture {
    return this.target.textures[1]!;
  }

  /** Take the size that belongs to a picture of `width` × `height` pixels, and the camera's view. */
  fit(camera: Camera, width: number, height: number): void {
    const { target } = this;
    target.setSize(Math.ceil(width / 2), Math.ceil(height / 2));
    this.scale.set(target.width / width, target.height / height);
    this.size.set(target.width, target.height);
    const p = camera.projectionMatrix.elements;
    this.unproject.set(1 / p[0]!, 1 / p[5]!, p[8]! / p[0]!, p[9]! / p[5]!);
  }

  dispose(): void {
    this.target.dispose();
  }
}
