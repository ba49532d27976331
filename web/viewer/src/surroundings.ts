/** What stands in a scene beside the loaded file: the visible bodies of its lamps, its sky, and light where it has none. */

import { type Environment, type Lamp, SkyBackground } from "lightwell";
import { type Box3, HemisphereLight, Light, type Object3D, type Scene, Vector3 } from "three";
import { LampGlow } from "./lamp-glow.ts";

/** Radius of the lamp's ball as a share of the diagonal of what is looked at. */
const BALL_SHARE = 0.006;

/** A file with learned light, whatever the renderer. */
export interface Lit {
  readonly root: Object3D;
  readonly core: Box3;
  readonly lamps: readonly Lamp[];
  readonly fields: readonly unknown[];
  readonly hasSky: boolean;
  readonly environment: Environment | null;
}

/** Owns them; lights and bodies hang in `scene`, and the owner puts the sky behind it. */
export class Surroundings {
  /** The sky behind the file; null where it has none. */
  readonly sky: SkyBackground | null;
  private readonly scene: Scene;
  private readonly lit: Lit;
  private glows: LampGlow[] = [];

  constructor(scene: Scene, lit: Lit) {
    [this.scene, this.lit] = [scene, lit];
    if (isUnlit(lit)) scene.add(new HemisphereLight(0xffffff, 0x8d8478, 2.5));
    this.sky = lit.hasSky ? new SkyBackground(lit.environment) : null;
    this.embody();
  }

  /** Give every point lamp a visible body. */
  embody(): void {
    for (const glow of this.glows) glow.dispose();
    const { lamps, core } = this.lit;
    const radius = core.getSize(new Vector3()).length() * BALL_SHARE;
    this.glows = lamps.filter((lamp) => lamp.variable.kind === "point").map((lamp) => new LampGlow(lamp, radius));
    for (const glow of this.glows) this.scene.add(glow.object);
  }

  /** Bring everything up to date before a frame. `still`: whether light that stands still is shown. */
  update(exposure: number, glowing: boolean, still: boolean): void {
    this.sky?.update(this.lit.lamps, still);
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
