/** Controls of one declared light. */

import { clockText, hourAt, type Lamp, northAt, SunLamp, turningOf } from "lightwell";
import { Color, Vector3 } from "three";
import type { Viewer } from "../viewer.ts";
import { createSection, createSlider } from "./controls.ts";
import { el } from "./dom.ts";

/** The intensity slider reaches this many stops below and above the baked intensity. */
const STOPS = 4;
/** Degrees by which angles may differ and still be the same. */
const SAME_ANGLE = 1e-3;
/** Units of the intensity, and what the place is, by kind. */
const UNITS = { point: "cd", sun: "lx", environment: "" };
const PLACES = { point: "Position, m", sun: "Direction", environment: "North" };

export function createLightControls(viewer: Viewer, index: number): HTMLElement {
  const lamp = viewer.lamps[index]!;
  const { variable } = lamp;
  const intensity = createSlider(
    "Intensity",
    [-STOPS, STOPS, 0.05],
    (stops) => `${format(variable.intensity * 2 ** stops)} ${UNITS[variable.kind]}`.trim(),
    (stops) => viewer.lampController.setIntensity(index, variable.intensity * 2 ** stops),
  );
  const color = el("input", { type: "color", "aria-label": "Colour of the light" });
  color.addEventListener("input", () => viewer.lampController.setColor(index, new Color(color.value)));
  const place = el("output", { class: "place" });
  const path = createPath(lamp, (value) => void viewer.lampController.move(index, value));
  const update = () => {
    intensity.set(
      variable.intensity > 0 ? Math.log2(Math.max(lamp.intensity, 1e-9) / variable.intensity) : 0,
    );
    const hex = `#${hexOf(lamp.color)}`;
    if (color.value !== hex && document.activeElement !== color) color.value = hex;
    place.value = lamp.value
      .toArray()
      .map((x) => x.toFixed(2))
      .join("  ");
    path?.update();
  };
  const stop = viewer.on("change", update);
  viewer.on("lamps", stop);
  update();
  const rows = [
    ...(path ? [path.element] : []),
    intensity.element,
    el("label", { class: "row" }, el("span", {}, "Colour"), color),
    el(
      "div",
      { class: "row" },
      el("span", {}, PLACES[variable.kind]),
      place,
    ),
  ];
  const section = createSection(lampName(viewer, index), ...rows);
  if (viewer.lampController.isAdded(index)) section.querySelector("h2")?.append(createRemove(viewer, index));
  return section;
}

/** The slider of a lamp that has one range: a sun along its path, a map that turns. Args: the lamp; takes its new value. */
function createPath(lamp: Lamp, move: (value: Vector3) => void): { element: HTMLElement; update(): void } | null {
  const map = turningOf([lamp]);
  if (map) {
    const { range } = map.variable;
    let shown = Number.NaN;
    const turn = (angle: number) => {
      shown = angle;
      move(new Vector3(...northAt(angle)));
    };
    const slider = createSlider("Rotation", [...range, 1], (angle) => `${Math.round(angle)}°`, turn);
    const update = () => {
      // Both ends of a whole turn are one direction: the slider stays where it was put.
      const away = Math.abs(map.angle - shown) % 360;
      if (!(Math.min(away, 360 - away) < SAME_ANGLE)) shown = map.angle;
      slider.set(shown);
    };
    return { element: slider.element, update };
  }
  if (!(lamp instanceof SunLamp)) return null;
  const slider = createSlider(
    lamp.variable.sky?.hours ? "Time" : "Path",
    [0, 1, 0.002],
    (t) => timeText(lamp, t),
    (t) => move(lamp.arc.at(t, new Vector3())),
  );
  return { element: slider.element, update: () => slider.set(lamp.time) };
}

/** The clock where there is one, else the share of the path. */
function timeText({ variable }: SunLamp, t: number): string {
  const hour = variable.sky ? hourAt(variable.sky, t) : null;
  return hour === null ? `${Math.round(t * 100)} %` : clockText(hour);
}

function createRemove(viewer: Viewer, index: number): HTMLElement {
  const onclick = () => viewer.lampController.remove(index);
  return el("button", { type: "button", class: "text", title: "Take this lamp away (−)", onclick }, "Remove");
}

/** The name of a lamp, with a number where there are several of its kind. */
export function lampName(viewer: Viewer, index: number): string {
  const { variable } = viewer.lamps[index]!;
  const name = variable.name.charAt(0).toUpperCase() + variable.name.slice(1);
  const alike = viewer.lamps.filter((lamp) => lamp.variable === variable);
  return alike.length > 1 ? `${name} ${alike.indexOf(viewer.lamps[index]!) + 1}` : name;
}

/** sRGB hex digits of a colour whose brightest component is brought to 1 when above. */
export function hexOf(color: Color): string {
  const peak = Math.max(color.r, color.g, color.b, 1);
  return color
    .clone()
    .multiplyScalar(1 / peak)
    .getHexString();
}

function format(value: number): string {
  return value >= 100 ? value.toFixed(0) : value.toPrecision(3);
}
