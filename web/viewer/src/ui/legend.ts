/** What the colours of the difference picture and of the experts mean. */

import { SEGMENT_COLORS } from "lightwell";
import type { Viewer } from "../viewer.ts";
import { el } from "./dom.ts";

const TICKS = ["−100 %", "−10", "±1", "+10", "+100 %"];

/** The legend of the mode that is shown; nothing where colours are light. */
export function createLegends(viewer: Viewer): readonly HTMLElement[] {
  return [createScale(viewer), createSwatches(viewer)];
}

/** Swatches of the first experts, and what stripes mean. */
function createSwatches(viewer: Viewer): HTMLElement {
  const swatches = SEGMENT_COLORS.map((color) => el("i", { style: `background:${color}` }));
  const legend = el(
    "figure",
    { class: "palette glass", "aria-label": "A colour for every expert" },
    el("div", { class: "ends" }, el("span", {}, "One colour an expert"), el("span", {}, "stripes: two share")),
    el("div", { class: "swatches", "aria-hidden": "true" }, ...swatches),
  );
  viewer.on("change", () => {
    legend.hidden = viewer.mode !== "experts";
  });
  legend.hidden = true;
  return legend;
}

function createScale(viewer: Viewer): HTMLElement {
  const ticks = el("div", { class: "ticks" }, ...TICKS.map((text) => el("span", {}, text)));
  const ends = el(
    "div",
    { class: "ends" },
    el("span", {}, "too dark"),
    el("span", {}, "stripes: nearly black"),
    el("span", {}, "too bright"),
  );
  const legend = el(
    "figure",
    { class: "legend glass", "aria-label": "Relative error, too dark to too bright" },
    ends,
    el("div", { class: "ramp" }),
    ticks,
  );
  viewer.on("change", () => {
    legend.hidden = viewer.mode !== "difference";
  });
  legend.hidden = true;
  return legend;
}
