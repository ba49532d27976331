/** Distances around a lamp of PlayCanvas, in six directions: the map that shadows are tested against. */

import {
  ADDRESS_CLAMP_TO_EDGE,
  type AppBase,
  ASPECT_MANUAL,
  Color,
  Entity,
  FILTER_NEAREST,
  type GraphicsDevice,
  type Layer,
  PIXELFORMAT_R32F,
  PIXELFORMAT_RGBA16F,
  RenderTarget,
  Texture,
  type Vec3,
} from "playcanvas";

/** Edge of a face in texels. */
export const CUBE_SIZE = 1024;
/** Name of the pass, in which materials of the file write their distance from the camera. */
export const DISTANCE_PASS = "lightwelldistance";
/** Before every other camera. */
const PRIORITY = -1000;
/** Euler angles of the cameras, degrees, in the order of the faces. */
const FACES = [[0, 90, 180], [0, -90, 180], [90, 0, 0], [-90, 0, 0], [0, 180, 180], [0, 0, 180]] as const;

/** Distances of the nearest and the farthest occluder, metres of the world. */
export interface Reach {
  readonly near: number;
  readonly far: number;
}

/** How distances are stored. */
export interface DistanceFormat {
  /** Of the texture. */
  readonly format: number;
  /** What lies in a direction without a surface. */
  readonly nothing: number;
}

/**
 * How a device can store distances: as floats, else as half floats (WebGL 2 without EXT_color_buffer_float, as on many phones);
 * null where it draws into neither.
 */
export function distanceFormat({ textureFloatRenderable, textureHalfFloatRenderable }: Pick<GraphicsDevice, "textureFloatRenderable" | "textureHalfFloatRenderable">): DistanceFormat | null {
  if (textureFloatRenderable) return { format: PIXELFORMAT_R32F, nothing: 1e9 };
  // Halves end at 65504.
  return textureHalfFloatRenderable ? { format: PIXELFORMAT_RGBA16F, nothing: 65504 } : null;
}

/** Six cameras that draw a layer when they are asked to. */
export class DistanceCube {
  readonly texture: Texture;
  private readonly eyes: readonly Entity[];
  private readonly targets: readonly RenderTarget[];

  constructor(app: AppBase, layer: Layer, { near, far }: Reach, { format, nothing }: DistanceFormat) {
    this.texture = new Texture(app.graphicsDevice, {
      name: "lightwell distances",
      cubemap: true,
      ...{ width: CUBE_SIZE, height: CUBE_SIZE, format, mipmaps: false },
      ...{ minFilter: FILTER_NEAREST, magFilter: FILTER_NEAREST, addressU: ADDRESS_CLAMP_TO_EDGE, addressV: ADDRESS_CLAMP_TO_EDGE },
    });
    this.targets = FACES.map((_, face) => new RenderTarget({ colorBuffer: this.texture, face, depth: true }));
    this.eyes = FACES.map(([x, y, z], face) => {
      const eye = new Entity(`lightwell distances ${face}`, app);
      eye.addComponent("camera", {
        ...{ renderTarget: this.targets[face]!, layers: [layer.id], priority: PRIORITY, clearColor: new Color(nothing, nothing, nothing, 1) },
        ...{ aspectRatioMode: ASPECT_MANUAL, aspectRatio: 1, fov: 90, nearClip: near, farClip: far },
      });
      eye.setEulerAngles(x, y, z);
      eye.camera!.setShaderPass(DISTANCE_PASS);
      eye.camera!.enabled = false;
      app.root.addChild(eye);
      return eye;
    });
  }

  /** Draw the distances from a place before the next frame. */
  draw(place: Vec3): void {
    for (const eye of this.eyes) {
      eye.setPosition(place);
      eye.camera!.enabled = true;
    }
  }

  /** They are drawn. */
  rest(): void {
    for (const eye of this.eyes) if (eye.camera!.enabled) eye.camera!.enabled = false;
  }

  dispose(): void {
    for (const eye of this.eyes) eye.destroy();
    for (const target of this.targets) target.destroy();
    this.texture.destroy();
  }
}
