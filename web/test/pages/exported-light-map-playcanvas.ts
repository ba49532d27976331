/** PlayCanvas with the light map that `lightwell export --to playcanvas` wrote, without lamps. */

import { Application, Asset, Color, type ContainerResource, Entity, GAMMA_SRGB, type LightComponent, type RenderComponent, type StandardMaterial, TONEMAP_NONE } from "playcanvas";
import { bytesOf, type Frame, publish, read } from "./exported-light-map.ts";

type Apply = (app: Application, entity: Entity, folder: string) => Promise<unknown>;

export function show(applyLightMap: Apply): void {
  publish(async (frame: Frame) => {
    const app = new Application(document.createElement("canvas"), { graphicsDeviceOptions: { antialias: false, preserveDrawingBuffer: true } });
    app.graphicsDevice.maxPixelRatio = 1;
    app.setCanvasResolution("FIXED", ...frame.size);
    app.scene.ambientLight = new Color(0, 0, 0);
    app.autoRender = false;
    app.start();
    const asset = new Asset("scene", "container", { url: "scene.glb", filename: "scene.glb", contents: bytesOf(frame) } as never);
    await new Promise<void>((resolve, reject) => {
      asset.once("load", () => resolve());
      asset.once("error", reject);
      app.assets.add(asset);
      app.assets.load(asset);
    });
    const root = (asset.resource as ContainerResource).instantiateRenderEntity();
    app.root.addChild(root);
    for (const light of root.findComponents("light") as LightComponent[]) light.enabled = false;
    for (const { meshInstances } of root.findComponents("render") as RenderComponent[]) {
      for (const { material } of meshInstances) {
        (material as StandardMaterial).emissive = new Color(0, 0, 0);
        material?.update();
      }
    }
    await applyLightMap(app, root, frame.folder);
    const eye = new Entity("camera", app);
    const clearColor = new Color(0, 0, 0, 1);
    eye.addComponent("camera", { fov: frame.fov, nearClip: frame.near, farClip: frame.far, clearColor, gammaCorrection: GAMMA_SRGB, toneMapping: TONEMAP_NONE });
    eye.setPosition(...frame.position);
    eye.lookAt(...frame.target);
    app.root.addChild(eye);
    app.renderNextFrame = true;
    await new Promise<void>((resolve) => void app.once("frameend", () => resolve()));
    return read((app.graphicsDevice as unknown as { gl: WebGL2RenderingContext }).gl, frame.size);
  });
}
