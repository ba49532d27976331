/** The button that copies the address of what is shown. */

import { linkTo } from "../page-state.ts";
import type { Viewer } from "../viewer.ts";
import { el, ICONS, icon } from "./dom.ts";

/** Copy the address of what is shown; where nothing can be copied it goes into the address bar. */
export async function copyLink(viewer: Viewer): Promise<void> {
  const link = linkTo(viewer, location.href);
  try {
    await navigator.clipboard.writeText(link);
    viewer.say("The link to this picture is copied.");
  } catch {
    try {
      history.replaceState(null, "", link);
      viewer.say("The address of the page is now that of this picture.");
    } catch {
      viewer.say(`This page has no address to share: ${link}`);
    }
  }
}

export function createCopyLink(viewer: Viewer): HTMLElement {
  const onclick = () => void copyLink(viewer);
  return el("button", { type: "button", class: "round glass", title: "Copy link (C)", "aria-label": "Copy link", onclick }, icon(ICONS.link));
}
