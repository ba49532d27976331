/** Exposure, tone curve and scene lights. */

import { TONE_MAPPING_TEXTS, TONE_MAPPINGS, type ToneMappingName } from "../tone-mapping.ts";
import type { Viewer } from "../viewer.ts";
import { createSection, createSlider } from "./controls.ts";
import { el } from "./dom.ts";

export function createPictureControls(viewer: Viewer): HTMLElement {
  const signed = (stops: number) =>
    `${stops > 0 ? "+" : stops < 0 ? "−" : ""}${Math.abs(stops).toFixed(1)} EV`;
  const exposure = createSlider("Exposure", [-5, 5, 0.1], signed, (stops) => viewer.setStops(stops));
  const options = TONE_MAPPINGS.map((name) => el("option", { value: name }, TONE_MAPPING_TEXTS[name].label));
  const curve = el("select", { "aria-label": "Tone curve" }, ...options);
  curve.addEventListener("change", () => viewer.setToneMapping(curve.value as ToneMappingName));
  const lights = el("input", { type: "checkbox", role: "switch" });
  lights.addEventListener("change", () => viewer.setStillLight(lights.checked));
  const half = el("input", { type: "checkbox", role: "switch" });
  half.addEventListener("change", () => viewer.setHalf(half.checked));
  const update = () => {
    exposure.set(viewer.stops);
    curve.value = viewer.toneMapping;
    lights.checked = viewer.stillLight;
    half.checked = viewer.half;
  };
  const stop = viewer.on("change", update);
  viewer.on("loaded", stop);
  update();
  const rows = [exposure.element, el("label", { class: "row" }, el("span", {}, "Tone curve"), curve)];
  if (viewer.learned?.hasStillLight) {
    rows.push(el("label", { class: "row" }, el("span", {}, "Scene lights"), lights));
  }
  if (viewer.fields.length > 0) {
    const title = "Evaluate the learned light for every fourth pixel and fill in along surfaces (R)";
    rows.push(el("label", { class: "row", title }, el("span", {}, "Half resolution"), half));
  }
  return createSection("Picture", ...rows);
}
