/** The strip of saved views. */

import { nameOfView } from "../view-moment.ts";
import type { Viewer } from "../viewer.ts";
import { el, ICONS, icon } from "./dom.ts";

/** Pixels of a thumbnail, twice its size on the page. */
const THUMB = { width: 144, height: 96 };

export function createViewsStrip(viewer: Viewer): HTMLElement {
  const strip = el("nav", { class: "views", "aria-label": "Saved views" });
  let buttons: HTMLButtonElement[] = [];
  viewer.on("loaded", () => {
    buttons = viewer.page.views.map((_, index) => createButton(viewer, index));
    strip.replaceChildren(createHome(viewer), ...buttons);
  });
  viewer.on("change", () => {
    buttons.forEach((button, index) => {
      button.setAttribute("aria-pressed", String(viewer.view === index));
    });
  });
  return strip;
}

function createHome(viewer: Viewer): HTMLElement {
  const onclick = () => viewer.goHome();
  const attributes = {
    type: "button",
    class: "home glass",
    title: "Start again (H)",
    "aria-label": "Start again",
    onclick,
  };
  return el("button", attributes, icon(ICONS.home));
}

function createButton(viewer: Viewer, index: number): HTMLButtonElement {
  const name = nameOfView(viewer.page.views[index]!, viewer.lamps);
  const canvas = el("canvas", { ...THUMB, "aria-hidden": "true" });
  const onclick = () => viewer.setView(index);
  const button = el(
    "button",
    { type: "button", class: "view glass", title: name, onclick },
    canvas,
    el("span", {}, name),
  );
  void drawThumbnail(viewer, index, canvas);
  return button;
}

async function drawThumbnail(viewer: Viewer, index: number, canvas: HTMLCanvasElement): Promise<void> {
  const view = viewer.page.views[index]!;
  const aspect = view.width / view.height;
  const width = Math.round(Math.max(THUMB.width, THUMB.height * aspect));
  const image = await viewer.thumbnail(index, width, Math.round(width / aspect)).catch(() => null);
  if (!image) return canvas.remove();
  canvas
    .getContext("2d")
    ?.putImageData(image, (THUMB.width - image.width) / 2, (THUMB.height - image.height) / 2);
  viewer.invalidate();
}
