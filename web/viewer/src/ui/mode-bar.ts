/** The segmented control of what is shown. */

import { MODE_TEXTS, MODES, type Mode } from "../modes.ts";
import type { Viewer } from "../viewer.ts";
import { el } from "./dom.ts";

export function createModeBar(viewer: Viewer): HTMLElement {
  const buttons = new Map<Mode, HTMLButtonElement>();
  for (const mode of MODES) {
    const { label, key, hint } = MODE_TEXTS[mode];
    const onclick = () => viewer.setMode(mode);
    const button = el("button", { type: "button", role: "radio", title: `${hint} (${key})`, onclick }, label);
    buttons.set(mode, button);
  }
  const bar = el(
    "div",
    { class: "modes glass", role: "radiogroup", "aria-label": "What is shown" },
    ...buttons.values(),
  );
  viewer.on("change", () => {
    for (const [mode, button] of buttons) {
      const checked = viewer.mode === mode;
      if (checked && button.ariaChecked !== "true")
        button.scrollIntoView({ block: "nearest", inline: "nearest" });
      button.setAttribute("aria-checked", String(checked));
      button.hidden = !viewer.offers(mode);
    }
  });
  return bar;
}
