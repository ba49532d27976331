/** Short messages that pass, one that stays, and one while the learned light is on its way. */

import type { Viewer } from "../viewer.ts";
import { el } from "./dom.ts";

const SHOWN_MS = 3600;

export function createNotices(viewer: Viewer): HTMLElement {
  const passing = el("p", { class: "notice glass", role: "status", "aria-live": "polite" });
  const staying = el("p", { class: "notice trouble glass", role: "alert", hidden: true });
  let timer = 0;
  viewer.on("notice", (text) => {
    passing.textContent = text;
    passing.classList.add("shown");
    clearTimeout(timer);
    timer = window.setTimeout(() => passing.classList.remove("shown"), SHOWN_MS);
  });
  viewer.on("trouble", (text) => {
    staying.textContent = text;
    staying.hidden = text === "";
  });
  const preparing = el("p", { class: "preparing glass", role: "status", hidden: true });
  preparing.append(el("i", { "aria-hidden": "true" }), "Preparing the learned light…");
  viewer.on("change", () => {
    preparing.hidden = !viewer.preparing || viewer.fields.length === 0;
  });
  return el("div", { class: "notices" }, staying, passing, preparing);
}
