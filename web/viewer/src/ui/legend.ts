/** The colour scale of the difference picture. */

import type { Viewer } from "../viewer.ts";
import { el } from "./dom.ts";

const TICKS = ["−100 %", "−10", "±1", "+10", "+100 %"];

export function createLegend(viewer: Viewer): HTMLElement {
  const ticks = el("div", { class: "ticks" }, ...TICKS.map((text) => el("span", {}, text)));
  const ends = el("div", { class: "ends" }, el("span", {}, "too dark"), el("span", {}, "too bright"));
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
