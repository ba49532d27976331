/** The visible body of a point lamp: a small bright ball in a soft halo. */

import type { Lamp } from "lightwell";
import {
  AdditiveBlending,
  CanvasTexture,
  Group,
  Mesh,
  MeshBasicMaterial,
  SphereGeometry,
  Sprite,
  SpriteMaterial,
} from "three";

/** Radiance of ball and halo over the exposure: they look alike in dim and in bright scenes. */
const BALL_RADIANCE = 14;
const HALO_RADIANCE = 0.9;
const HALO_PIXELS = 128;

/** Follows a lamp; it casts no shadow and is not part of any comparison. */
export class LampGlow {
  readonly object = new Group();
  private readonly ball: Mesh<SphereGeometry, MeshBasicMaterial>;
  private readonly halo: Sprite;
  private readonly lamp: Lamp;

  constructor(lamp: Lamp, radius: number) {
    this.lamp = lamp;
    this.ball = new Mesh(new SphereGeometry(radius, 24, 16), new MeshBasicMaterial());
    const halo = { map: haloTexture(), blending: AdditiveBlending, depthWrite: false, transparent: true };
    this.halo = new Sprite(new SpriteMaterial(halo));
    this.halo.scale.setScalar(radius * 14);
    this.object.add(this.ball, this.halo);
  }

  update(exposure: number, visible: boolean): void {
    this.object.visible = visible && this.lamp.intensity > 0;
    this.object.position.copy(this.lamp.value);
    this.ball.material.color.copy(this.lamp.color).multiplyScalar(BALL_RADIANCE / exposure);
    this.halo.material.color.copy(this.lamp.color).multiplyScalar(HALO_RADIANCE / exposure);
  }

  dispose(): void {
    this.object.removeFromParent();
    this.ball.geometry.dispose();
    this.ball.material.dispose();
    this.halo.material.map?.dispose();
    this.halo.material.dispose();
  }
}

function haloTexture(): CanvasTexture {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = HALO_PIXELS;
  const context = canvas.getContext("2d")!;
  const half = HALO_PIXELS / 2;
  const gradient = context.createRadialGradient(half, half, 0, half, half, half);
  for (let i = 0; i <= 16; i++) {
    const fade = (1 - i / 16) ** 3;
    gradient.addColorStop(i / 16, `rgba(255,255,255,${fade})`);
  }
  context.fillStyle = gradient;
  context.fillRect(0, 0, HALO_PIXELS, HALO_PIXELS);
  return new CanvasTexture(canvas);
}
