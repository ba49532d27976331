/** The help sheet. */

import { MODE_TEXTS, MODES } from "../modes.ts";
import { el, ICONS, icon } from "./dom.ts";

const ROWS: readonly (readonly [keys: string, meaning: string])[] = [
  ["Drag · one finger", "Orbit"],
  ["Scroll · pinch", "Zoom"],
  ["Right drag · two fingers", "Pan"],
  ["Drag the lamp", "Move the light; wheel over it: depth"],
  ["Arrows, Page ↑ ↓", "Fly: ahead, back, turn, up, down; Shift: aside"],
  ["The same on a lamp", "Move the light when it has focus; Shift: finer"],
  ["+ · −", "Add a lamp, remove the last one; Delete: the one that has focus"],
  ["R", "Learned light at half resolution, or at full"],
  ["S", "Split against direct light, the reference, or an ordinary light map"],
  ["F", "Lens: depth of field; click on what shall be sharp"],
  ["V", "Next saved view"],
  ["H", "Start again"],
  ["L", "Focus the light"],
  ["C", "Copy a link to what is shown"],
  ["P", "Show or hide the controls"],
  ["?", "This help"],
];

export function createHelp(): { element: HTMLDialogElement; button: HTMLElement; toggle(): void } {
  const modes = MODES.map(
    (mode) => [MODE_TEXTS[mode].key, `${MODE_TEXTS[mode].label}: ${MODE_TEXTS[mode].hint}`] as const,
  );
  const rows = [...modes, ...ROWS].flatMap(([keys, meaning]) => [
    el("dt", {}, el("kbd", {}, keys)),
    el("dd", {}, meaning),
  ]);
  const close = el(
    "button",
    { type: "button", class: "round", "aria-label": "Close", onclick: () => element.close() },
    icon(ICONS.close),
  );
  const about =
    "The light that comes straight from the lamp is rasterised. All other light, bounced from surface to " +
    "surface, is computed for every pixel by a small learned function. Light adds up: several lamps are the " +
    "sum of the same function.";
  const element = el(
    "dialog",
    { class: "help glass", "aria-label": "Help" },
    close,
    el("h1", {}, "lightwell"),
    el("p", {}, about),
    el("dl", {}, ...rows),
  );
  element.addEventListener("click", (event) => {
    if (event.target === element) element.close();
  });
  const toggle = () => (element.open ? element.close() : element.showModal());
  const button = el(
    "button",
    { type: "button", class: "round glass", title: "Help (?)", "aria-label": "Help", onclick: toggle },
    icon(ICONS.help),
  );
  return { element, button, toggle };
}
