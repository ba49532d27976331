/** The line between the learned picture and what it is compared with: direct light, the reference, or a light map. */

import type { Viewer } from "../viewer.ts";
import { el } from "./dom.ts";

const KEY_STEP = 0.02;

/** Names of the left picture. */
const LEFT = { direct: "Direct only", reference: "Reference", lightmap: "Light map" } as const;

export function createSplitHandle(viewer: Viewer): HTMLElement {
  const left = el("button", { type: "button", class: "left", onclick: () => viewer.nextAgainst() });
  left.addEventListener("pointerdown", (event) => event.stopPropagation());
  const handle = el(
    "div",
    {
      class: "split",
      role: "slider",
      tabindex: 0,
      "aria-label": "Border between the left and the learned picture",
      "aria-valuemin": 0,
      "aria-valuemax": 100,
      hidden: true,
    },
    left,
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
    left.textContent = LEFT[viewer.against];
    left.disabled = !viewer.hasReferences && !viewer.hasLightmaps;
    left.title = left.disabled ? "" : "Direct light, reference or light map (S)";
    handle.style.left = `${100 * viewer.split}%`;
    handle.setAttribute("aria-valuenow", String(Math.round(100 * viewer.split)));
  });
  return handle;
}
