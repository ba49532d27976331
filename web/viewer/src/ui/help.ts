/** The help sheet. */

import { MODE_TEXTS, MODES } from "../modes.ts";
import type { Viewer } from "../viewer.ts";
import { el, ICONS, icon } from "./dom.ts";
import type { Shortcuts } from "./shortcuts.ts";

type Row = readonly [keys: string, meaning: string];

const GESTURES: readonly Row[] = [
  ["Drag · one finger", "Orbit"],
  ["Scroll · pinch", "Zoom"],
  ["Right drag · two fingers", "Pan"],
  ["Drag the lamp", "Move the light; wheel over it: depth"],
];

const KEYS: readonly Row[] = [
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

/** Who touches the screen reads of fingers first. */
const TOUCH = "(pointer: coarse)";

/** What there is to press and to drag, without the modes that the file has nothing for. */
function rowsOf(viewer: Viewer): readonly Row[] {
  const modes = MODES.filter((mode) => viewer.offers(mode)).map((mode): Row => [MODE_TEXTS[mode].key, `${MODE_TEXTS[mode].label}: ${MODE_TEXTS[mode].hint}`]);
  const keys = KEYS.filter(([key]) => key !== "V" || viewer.page.views.length > 0);
  return matchMedia(TOUCH).matches ? [...GESTURES, ...modes, ...keys] : [...modes, ...GESTURES, ...keys];
}

export function createHelp(viewer: Viewer, shortcuts: Shortcuts): { element: HTMLDialogElement; button: HTMLElement; toggle(): void } {
  const list = el("dl");
  const keysOn = el("input", { type: "checkbox", role: "switch" });
  keysOn.addEventListener("change", () => {
    shortcuts.on = keysOn.checked;
  });
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
    el("label", { class: "row" }, el("span", {}, "Single keys are shortcuts"), keysOn),
    list,
  );
  element.addEventListener("click", (event) => {
    if (event.target === element) element.close();
  });
  const toggle = () => {
    if (element.open) return element.close();
    keysOn.checked = shortcuts.on;
    list.replaceChildren(...rowsOf(viewer).flatMap(([keys, meaning]) => [el("dt", {}, el("kbd", {}, keys)), el("dd", {}, meaning)]));
    element.showModal();
  };
  const button = el(
    "button",
    { type: "button", class: "round glass", title: "Help (?)", "aria-label": "Help", onclick: toggle },
    icon(ICONS.help),
  );
  return { element, button, toggle };
}
