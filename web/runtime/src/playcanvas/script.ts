/** The script of PlayCanvas that shows a file. */

import { Script } from "playcanvas";
import type { LearnedLight } from "./learned-light.ts";
import { loadLearned } from "./load-learned.ts";

/** Loads `src` and hangs it on its entity; fires `load` with the light, or `error`. */
export class LightwellScene extends Script {
  static override scriptName = "lightwellScene";

  /**
   * Address of the file.
   * @attribute
   */
  src = "";
  light: LearnedLight | null = null;
  private gone = false;

  initialize(): void {
    this.once("destroy", () => {
      this.gone = true;
      this.light?.dispose();
    });
    void loadLearned(this.app, this.src).then(
      (light) => {
        if (this.gone) return light.dispose();
        this.light = light;
        this.entity.addChild(light.root);
        this.fire("load", light);
      },
      (error: Error) => {
        console.error(error.message);
        this.fire("error", error);
      },
    );
  }
}
