/** What a page without a scene shows, and files that are dropped at any time. */

import { type LoadedAsset, loadFile } from "../asset.ts";
import { el } from "./dom.ts";

/** A card that asks for a file. */
export function createWelcome(open: (asset: Promise<LoadedAsset>) => void): HTMLElement {
  const input = el("input", { type: "file", accept: ".glb,model/gltf-binary", class: "hidden-input" });
  input.addEventListener("change", () => {
    const file = input.files?.[0];
    if (file) open(loadFile(file));
  });
  const label = el("label", { class: "choose" }, "Choose a file", input);
  return el(
    "div",
    { class: "welcome" },
    el("h1", {}, "lightwell"),
    el("p", {}, "Drop a .glb with learned light here."),
    label,
  );
}

/** Opens a file that is dropped anywhere on the page. */
export function acceptDrops(open: (asset: Promise<LoadedAsset>) => void): void {
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    const file = event.dataTransfer?.files[0];
    if (file) open(loadFile(file));
  });
}
