/** Learned light in PlayCanvas: load a file, hang it into the scene, move its lamp. */

import { loadLearned } from "lightwell/playcanvas";
import { Application, Color, Entity, FILLMODE_FILL_WINDOW, RESOLUTION_AUTO, TONEMAP_NEUTRAL } from "playcanvas";

const app = new Application(document.querySelector("canvas")!);
app.setCanvasFillMode(FILLMODE_FILL_WINDOW);
app.setCanvasResolution(RESOLUTION_AUTO);
app.scene.ambientLight = new Color(0, 0, 0);
app.start();

const light = await loadLearned(app, "scene.glb");
app.root.addChild(light.root);
const eye = new Entity("camera", app);
eye.addComponent("camera", { fov: 40, toneMapping: TONEMAP_NEUTRAL, clearColor: new Color(0.01, 0.01, 0.01) });
eye.setPosition(0, 1, 4.2);
app.root.addChild(eye);

const [lamp] = light.lamps;
const home = lamp?.entity.getLocalPosition().clone();
app.on("update", () => {
  // An entity as any other; it stays inside the box in which its light was learned.
  if (lamp && home) lamp.entity.setLocalPosition(home.x + 0.3 * Math.sin(performance.now() / 1500), home.y, home.z);
});
