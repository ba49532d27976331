/** Controls of the test object: shown or not, moved by a slider or dragged in the picture. */

import { Plane, Raycaster, Vector2, Vector3 } from "three";
import type { Viewer } from "../viewer.ts";
import { createSection, createSlider } from "./controls.ts";
import { el } from "./dom.ts";

/** Controls of the test object; null where the file has no probes. */
export function createObjectControls(viewer: Viewer): HTMLElement | null {
  const { object } = viewer;
  if (!object) return null;
  const shown = el("input", { type: "checkbox", role: "switch" });
  shown.addEventListener("change", () => {
    object.shown = shown.checked;
    viewer.touch();
  });
  const slider = createSlider("Move it (or drag it)", [0, 1, 0.002], (share) => `${Math.round(100 * share)} %`, (share) => {
    object.along = share;
    viewer.touch();
  });
  const update = () => {
    shown.checked = object.shown;
    slider.set(object.along);
  };
  const stop = viewer.on("change", update);
  viewer.on("loaded", stop);
  update();
  const title = "Something that is not of the file, lit by its probes; walls keep the field";
  return createSection("Test object", el("label", { class: "row", title }, el("span", {}, "Lit by probes"), shown), slider.element);
}

/** The test object follows the pointer in a plane that faces the eye. */
export function listenToObject(viewer: Viewer): void {
  const { canvas } = viewer;
  const [ray, plane] = [new Raycaster(), new Plane()];
  let held = false;
  const aim = (event: PointerEvent) => {
    const box = canvas.getBoundingClientRect();
    ray.setFromCamera(new Vector2((2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height), viewer.rig.camera);
  };
  canvas.addEventListener("pointerdown", (event) => {
    const { object } = viewer;
    if (!object?.mesh.visible) return;
    aim(event);
    const [hit] = ray.intersectObject(object.mesh);
    const [wall] = viewer.learned ? ray.intersectObject(viewer.learned.root, true) : [];
    held = hit !== undefined && (wall === undefined || hit.distance < wall.distance);
    viewer.rig.controls.enabled = !held;
    if (held) plane.setFromNormalAndCoplanarPoint(viewer.rig.camera.getWorldDirection(new Vector3()), object.mesh.position);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!held || !viewer.object) return;
    aim(event);
    const place = ray.ray.intersectPlane(plane, new Vector3());
    if (place) viewer.object.move(place);
    viewer.touch();
  });
  for (const name of ["pointerup", "pointercancel"] as const) {
    canvas.addEventListener(name, () => {
      held = false;
      viewer.rig.controls.enabled = true;
    });
  }
}
