/** The line between reference and learned picture. */

import type { Viewer } from "../viewer.ts";
import { el } from "./dom.ts";

const KEY_STEP = 0.02;

export function createSplitHandle(viewer: Viewer): HTMLElement {
  const handle = el(
    "div",
    {
      class: "split",
      role: "slider",
      tabindex: 0,
      "aria-label": "Border between reference and learned picture",
      "aria-valuemin": 0,
      "aria-valuemax": 100,
      hidden: true,
    },
    el("span", { class: "left" }, "Reference"),
    el("i", {}),
    el("span", { class: "right" }, "Learned"),
  );
  handle.addEventListener("pointerdown", (event) => handle.setPointerCapture(event.pointerId));
  handle.addEventListener("pointermove", (event) => {
    if (!handle.hasPointerCapture(event.pointerId)) return;
    const box = viewer.canvas.getBoundingClientRect();
    viewer.setSplit((event.clientX - box.left) / box.width);
  });
  handle.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -KEY_STEP, ArrowRight: KEY_STEP }[event.key];
    if (!step) return;
    event.preventDefault();
    viewer.setSplit(viewer.split + step);
  });
  viewer.on("change", () => {
    handle.hidden = viewer.mode !== "split";
    handle.style.left = `${100 * viewer.split}%`;
    handle.setAttribute("aria-valuenow", String(Math.round(100 * viewer.split)));
  });
  return handle;
}
