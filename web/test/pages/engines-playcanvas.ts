/** PlayCanvas draws the same. */

import { loadLearned } from "lightwell/playcanvas";
import { Application, Color, Entity, GAMMA_SRGB, TONEMAP_NONE } from "playcanvas";
import { CAMERA, glb, publish, SIZE } from "./engines-shot.ts";

const [width, height] = SIZE;
const canvas = document.createElement("canvas");
const app = new Application(canvas, { graphicsDeviceOptions: { antialias: false, preserveDrawingBuffer: true } });
app.graphicsDevice.maxPixelRatio = 1;
app.setCanvasResolution("FIXED", width, height);
app.scene.ambientLight = new Color(0, 0, 0);
// The test says when a frame is drawn.
app.autoRender = false;
app.start();

const ended = () => new Promise<void>((resolve) => void app.once("frameend", () => resolve()));
const gl = (app.graphicsDevice as unknown as { gl: WebGL2RenderingContext }).gl;

/** Lose the context, and come back. */
async function restored(): Promise<void> {
  const back = new Promise<void>((resolve) => void app.graphicsDevice.once("devicerestored", () => resolve()));
  const extension = gl.getExtension("WEBGL_lose_context")!;
  extension.loseContext();
  await new Promise((resolve) => setTimeout(resolve, 50));
  extension.restoreContext();
  await back;
}

publish(async ({ light, parts }) => {
  const learned = await loadLearned(app, glb());
  // The same file once more, elsewhere: neither takes anything from the other.
  const other = await loadLearned(app, glb());
  other.root.setLocalPosition(0, 100, 0);
  app.root.addChild(other.root);
  app.root.addChild(learned.root);
  const eye = new Entity("camera", app);
  eye.addComponent("camera", { fov: CAMERA.fov, nearClip: 0.05, farClip: 50, clearColor: new Color(0, 0, 0, 1), gammaCorrection: GAMMA_SRGB, toneMapping: TONEMAP_NONE });
  eye.setPosition(...CAMERA.position);
  eye.lookAt(...CAMERA.target);
  app.root.addChild(eye);
  if (light) learned.lamps[0]!.entity.setLocalPosition(...light);
  learned.show(parts);
  // Frames that are not drawn.
  for (let i = 0; i < 2; i++) await ended();
  app.renderNextFrame = true;
  await ended();
  if (light) {
    await restored();
    app.renderNextFrame = true;
    await ended();
  }
  const rows = new Uint8Array(4 * width * height);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rows);
  eye.destroy();
  learned.dispose();
  other.dispose();
  return rows;
});
