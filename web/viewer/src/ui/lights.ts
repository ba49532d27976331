/** Controls of all lamps, and the button that adds one. */

import { MAX_LAMPS } from "lightwell";
import type { Viewer } from "../viewer.ts";
import { el } from "./dom.ts";
import { createLightControls } from "./light-controls.ts";

export function createLights(viewer: Viewer): HTMLElement {
  const element = el("div", { class: "lights" });
  const fill = () => {
    const lights = viewer.lamps.map((_, index) => createLightControls(viewer, index));
    // A map that turns is one; what is added is of the kind of the first lamp.
    const room = lights.length < MAX_LAMPS && viewer.lamps[0] !== undefined && viewer.lamps[0].variable.kind !== "environment";
    element.replaceChildren(...lights, ...(room ? [createAdd(viewer)] : []));
  };
  const stop = viewer.on("lamps", fill);
  viewer.on("loaded", stop);
  fill();
  return element;
}

function createAdd(viewer: Viewer): HTMLElement {
  return el(
    "button",
    {
      type: "button",
      class: "text add",
      title: "Add a lamp: light adds up, so the same field plays it back (+)",
      onclick: () => viewer.lampController.add(),
    },
    "Add a lamp",
  );
}
