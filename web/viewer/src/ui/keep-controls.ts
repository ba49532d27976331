/** Buttons that save a picture and record a turn. */

import { recordTurn, takePicture } from "../turn.ts";
import type { Viewer } from "../viewer.ts";
import { createSection } from "./controls.ts";
import { el } from "./dom.ts";

export function createKeepControls(viewer: Viewer): HTMLElement {
  const picture = el("button", { type: "button", class: "keep" }, "Save picture");
  const film = el("button", { type: "button", class: "keep" }, "Record turn");
  picture.addEventListener("click", () => void keep(viewer, "png", takePicture(viewer)));
  film.addEventListener("click", async () => {
    film.disabled = true;
    const done = recordTurn(viewer, undefined, (share) => {
      film.textContent = `Recording ${Math.round(100 * share)} %`;
    });
    await keep(viewer, "webm", done);
    film.disabled = false;
    film.textContent = "Record turn";
  });
  return createSection("Keep", el("div", { class: "row" }, picture, film));
}

/** Hand a file to the visitor, under the name of the scene. */
async function keep(viewer: Viewer, kind: string, made: Promise<Blob>): Promise<void> {
  try {
    const blob = await made;
    const name = viewer.title.toLowerCase().replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "") || "scene";
    const href = URL.createObjectURL(blob);
    el("a", { href, download: `${name}.${blob.type === "video/mp4" ? "mp4" : kind}` }).click();
    setTimeout(() => URL.revokeObjectURL(href), 60_000);
  } catch (error) {
    viewer.say(error instanceof Error ? error.message : String(error));
  }
}
