/** What stands in a scene beside the loaded file: the visible bodies of its lamps, its sky, and light where it has none. */

import { type Lamp, SkyBackground, sunsWithSky } from "lightwell";
import { type Box3, HemisphereLight, Light, type Object3D, type Scene, Vector3 } from "three";
import { LampGlow } from "./lamp-glow.ts";

/** Radius of the lamp's ball as a share of the scene's diagonal. */
const BALL_SHARE = 0.006;

/** A file with learned light, whatever the renderer. */
export interface Lit {
  readonly root: Object3D;
  readonly bounds: Box3;
  readonly lamps: readonly Lamp[];
  readonly fields: readonly unknown[];
}

/** Owns them; lights and bodies hang in `scene`, and the owner puts the sky behind it. */
export class Surroundings {
  /** The sky of the file's suns; null where it has none. */
  readonly sky: SkyBackground | null;
  private readonly scene: Scene;
  private readonly lit: Lit;
  private glows: LampGlow[] = [];

  constructor(scene: Scene, lit: Lit) {
    [this.scene, this.lit] = [scene, lit];
    if (isUnlit(lit)) scene.add(new HemisphereLight(0xffffff, 0x8d8478, 2.5));
    this.sky = sunsWithSky(lit.lamps).length > 0 ? new SkyBackground() : null;
    this.embody();
  }

  /** Give every point lamp a visible body. */
  embody(): void {
    for (const glow of this.glows) glow.dispose();
    const { lamps, bounds } = this.lit;
    const radius = bounds.getSize(new Vector3()).length() * BALL_SHARE;
    this.glows = lamps.filter((lamp) => lamp.variable.kind === "point").map((lamp) => new LampGlow(lamp, radius));
    for (const glow of this.glows) this.scene.add(glow.object);
  }

  /** Bring everything up to date before a frame. */
  update(exposure: number, glowing: boolean): void {
    this.sky?.update(this.lit.lamps);
    for (const glow of this.glows) glow.update(exposure, glowing);
  }

  dispose(): void {
    for (const glow of this.glows) glow.dispose();
    this.sky?.dispose();
  }
}

/** Whether nothing would light the scene. */
function isUnlit({ root, fields }: Lit): boolean {
  let lights = fields.length;
  root.traverse((object) => {
    if (object instanceof Light) lights++;
  });
  return lights === 0;
}
