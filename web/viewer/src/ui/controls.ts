/** Labelled controls of the panel. */

import { el } from "./dom.ts";

/** A slider with a label and a readout; `set` shows a value. */
export interface Slider {
  readonly element: HTMLElement;
  set(value: number): void;
}

/** A slider over [low, high]; `show` writes its readout. */
export function createSlider(
  label: string,
  [low, high, step]: readonly [number, number, number],
  show: (value: number) => string,
  onInput: (value: number) => void,
): Slider {
  const output = el("output");
  const input = el("input", { type: "range", min: low, max: high, step, "aria-label": label });
  const set = (value: number) => {
    const shown = show(value);
    if (document.activeElement !== input || Math.abs(Number(input.value) - value) > step)
      input.value = String(value);
    output.value = shown;
    input.setAttribute("aria-valuetext", shown);
    input.style.setProperty("--fill", `${(100 * (Number(input.value) - low)) / (high - low)}%`);
  };
  input.addEventListener("input", () => {
    onInput(Number(input.value));
    set(Number(input.value));
  });
  return { element: el("label", { class: "slider" }, el("span", {}, label), output, input), set };
}

/** A titled group of controls. */
export function createSection(title: string, ...children: (Node | string)[]): HTMLElement {
  return el("section", {}, el("h2", {}, title), ...children);
}
