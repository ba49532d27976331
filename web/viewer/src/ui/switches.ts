/** Switches of the scene's own lamps: on or off, dimmer, colour; a click on a lamp in the picture switches it too. */

import type { LampSwitch } from "lightwell";
import { Color, Mesh, Raycaster, Vector2 } from "three";
import type { Viewer } from "../viewer.ts";
import { createSection } from "./controls.ts";
import { el } from "./dom.ts";
import { hexOf } from "./light-controls.ts";

/** The dimmer reaches this many times the light of the bake; a click is a press that moves less than this many pixels. */
const MOST = 2;
const CLICK_PIXELS = 4;

/** Controls of all lamps; null where the file has none that can be switched. */
export function createSwitches(viewer: Viewer): HTMLElement | null {
  const lamps = viewer.learned?.switches ?? [];
  if (lamps.length === 0) return null;
  const rows = lamps.map((lamp) => createRow(viewer, lamp));
  const update = () => rows.forEach(({ show }) => show());
  const stops = [viewer.on("change", update), listenForClicks(viewer)];
  const stop = viewer.on("loaded", () => [...stops, stop].forEach((end) => end()));
  update();
  const every = (text: string, intensity: (lamp: LampSwitch) => number) => {
    const onclick = () => lamps.forEach((lamp) => viewer.setLamp(lamp.name, intensity(lamp)));
    return el("button", { type: "button", class: "text", onclick }, text);
  };
  const section = createSection("Lamps", ...rows.map(({ element }) => element));
  const all = el("span", { class: "every" }, every("All on", ({ record }) => record.intensity || 1), every("All off", () => 0));
  if (lamps.length > 1) section.querySelector("h2")?.append(all);
  return section;
}

function createRow(viewer: Viewer, lamp: LampSwitch): { element: HTMLElement; show(): void } {
  const { name } = lamp;
  const on = el("input", { type: "checkbox", role: "switch", "aria-label": `${name}, on or off` });
  const dimmer = el("input", { type: "range", min: 0, max: MOST, step: 0.01, "aria-label": `${name}, brightness` });
  const color = el("input", { type: "color", "aria-label": `${name}, colour` });
  on.addEventListener("change", () => toggle(viewer, lamp));
  dimmer.addEventListener("input", () => viewer.setLamp(name, Number(dimmer.value)));
  color.addEventListener("input", () => viewer.setLamp(name, { color: new Color(color.value) }));
  const show = () => {
    on.checked = lamp.intensity > 0;
    dimmer.value = String(lamp.intensity);
    dimmer.setAttribute("aria-valuetext", `${Math.round(100 * lamp.intensity)} %`);
    dimmer.style.setProperty("--fill", `${Math.min(100, (100 * lamp.intensity) / MOST)}%`);
    const hex = `#${hexOf(lamp.color)}`;
    if (color.value !== hex && document.activeElement !== color) color.value = hex;
  };
  return { element: el("div", { class: "switch" }, on, el("span", { title: name }, name.replaceAll("_", " ")), dimmer, color), show };
}

/** Dimmers before their lamps were switched off. */
const before = new WeakMap<LampSwitch, number>();

function toggle(viewer: Viewer, lamp: LampSwitch): void {
  const { intensity } = lamp;
  if (intensity > 0) before.set(lamp, intensity);
  viewer.setLamp(lamp.name, intensity > 0 ? 0 : (before.get(lamp) ?? (lamp.record.intensity || 1)));
}

/** A click on a surface that shines, or did, switches its lamp. Returns a function that ends it. */
function listenForClicks(viewer: Viewer): () => void {
  const { canvas } = viewer;
  let pressed: readonly [number, number] | null = null;
  const down = (event: PointerEvent) => {
    pressed = event.button === 0 ? [event.clientX, event.clientY] : null;
  };
  const up = (event: PointerEvent) => {
    const still = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < CLICK_PIXELS;
    pressed = null;
    const lamp = still ? lampUnder(viewer, event) : null;
    if (lamp) toggle(viewer, lamp);
  };
  canvas.addEventListener("pointerdown", down);
  canvas.addEventListener("pointerup", up);
  return () => {
    canvas.removeEventListener("pointerdown", down);
    canvas.removeEventListener("pointerup", up);
  };
}

function lampUnder(viewer: Viewer, { clientX, clientY }: PointerEvent): LampSwitch | null {
  const { learned, rig, canvas } = viewer;
  if (!learned) return null;
  const { left, top, width, height } = canvas.getBoundingClientRect();
  const ray = new Raycaster();
  ray.setFromCamera(new Vector2((2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height), rig.camera);
  const hit = ray.intersectObject(learned.root, true).find(({ object }) => object instanceof Mesh);
  return hit ? learned.switchOf(hit.object) : null;
}
