/** The collapsible panel: light, picture, numbers. */

import type { Viewer } from "../viewer.ts";
import { el, ICONS, icon } from "./dom.ts";
import { createKeepControls } from "./keep-controls.ts";
import { createLensControls } from "./lens-controls.ts";
import { createLights } from "./lights.ts";
import { createMovers } from "./mover-controls.ts";
import { createNumbers } from "./numbers.ts";
import { createObjectControls } from "./object-controls.ts";
import { createPictureControls } from "./picture-controls.ts";
import { createSwitches } from "./switches.ts";
import { createTextures } from "./textures.ts";

/** Narrower pages start with the panel closed. */
const WIDE = "(min-width: 720px)";

export function createPanel(viewer: Viewer): HTMLElement {
  const body = el("div", { class: "panel-body", id: "panel-body" });
  const toggle = el(
    "button",
    {
      type: "button",
      class: "round glass",
      "aria-controls": "panel-body",
      title: "Controls (P)",
      "aria-label": "Controls",
    },
    icon(ICONS.sliders),
  );
  const panel = el("aside", { class: "panel", "aria-label": "Controls" }, toggle, body);
  const setOpen = (open: boolean) => {
    panel.classList.toggle("open", open);
    toggle.setAttribute("aria-expanded", String(open));
    body.inert = !open;
  };
  toggle.addEventListener("click", () => setOpen(!panel.classList.contains("open")));
  setOpen(matchMedia(WIDE).matches);
  body.classList.add("glass");
  viewer.on("loaded", () => {
    const switches = createSwitches(viewer);
    const own = [createMovers(viewer), switches, createObjectControls(viewer)].filter((section) => section !== null);
    body.replaceChildren(...own, createLights(viewer), createPictureControls(viewer), createLensControls(viewer), createKeepControls(viewer), createNumbers(viewer), ...createTextures(viewer));
  });
  return panel;
}
