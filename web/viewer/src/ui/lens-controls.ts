/** The lens: on or off, f-number, focus by slider or by click. */

import { FOCUS_RANGE, FSTOP_RANGE } from "../lens-controller.ts";
import type { Viewer } from "../viewer.ts";
import { createSection, createSlider } from "./controls.ts";
import { el } from "./dom.ts";

/** A press that moves farther turns the camera, CSS pixels. */
const STILL = 4;

export function createLensControls(viewer: Viewer): HTMLElement {
  const { lens, canvas } = viewer;
  const on = el("input", { type: "checkbox", role: "switch" });
  on.addEventListener("change", () => void lens.set(on.checked));
  const stops = FSTOP_RANGE.map((n) => 2 * Math.log2(n)) as [number, number];
  const fstop = createSlider("Aperture", [...stops, 0.1], (v) => `f/${(2 ** (v / 2)).toFixed(1)}`, (v) => void lens.set(lens.on, { fstop: 2 ** (v / 2) }));
  const far = FOCUS_RANGE.map((n) => Math.log10(n)) as [number, number];
  const focus = createSlider("Focus", [...far, 0.01], (v) => `${(10 ** v).toFixed(2)} m`, (v) => void lens.set(lens.on, { focus: 10 ** v }));
  let pressed = [0, 0];
  const press = (event: PointerEvent) => void (pressed = [event.clientX, event.clientY]);
  const click = (event: MouseEvent) => {
    if (!lens.on || Math.hypot(event.clientX - pressed[0]!, event.clientY - pressed[1]!) > STILL) return;
    const { left, top, width, height } = canvas.getBoundingClientRect();
    lens.focusUnder((2 * (event.clientX - left)) / width - 1, 1 - (2 * (event.clientY - top)) / height);
  };
  canvas.addEventListener("pointerdown", press);
  canvas.addEventListener("click", click);
  const update = () => {
    on.checked = lens.on;
    fstop.set(2 * Math.log2(lens.setting.fstop));
    focus.set(Math.log10(lens.setting.focus));
    fstop.element.hidden = focus.element.hidden = !lens.on;
  };
  const stop = viewer.on("change", update);
  viewer.on("loaded", () => {
    stop();
    canvas.removeEventListener("pointerdown", press);
    canvas.removeEventListener("click", click);
  });
  update();
  const title = "Depth of field of a full-frame camera; click on what shall be sharp (F)";
  return createSection("Lens", el("label", { class: "row", title }, el("span", {}, "Depth of field"), on), fstop.element, focus.element);
}
