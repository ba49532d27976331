/** What it costs and how far it is from the reference. */

import type { Viewer } from "../viewer.ts";
import { createSection } from "./controls.ts";
import { el } from "./dom.ts";

/** Entries of a bake's report that are shown: name, label, how they are written. */
const REPORT: readonly (readonly [name: string, label: string, write: (x: number) => string])[] = [
  ["relative_error", "Error of the bake", percent],
  ["noise_floor", "Noise of the reference", percent],
  ["psnr_db", "PSNR", decibels],
  ["flip", "FLIP", (x) => x.toFixed(3)],
  ["seconds", "Bake time", seconds],
];

export function createNumbers(viewer: Viewer): HTMLElement {
  const list = el("dl", { class: "numbers" });
  const update = () => {
    const rows = [...costs(viewer), ...thisView(viewer), ...report(viewer)];
    list.replaceChildren(...rows.flatMap(([name, value]) => [el("dt", {}, name), el("dd", {}, value)]));
  };
  const stops = [viewer.on("change", update), viewer.on("frame", () => updateTime(viewer, list))];
  viewer.on("loaded", () => {
    for (const stop of stops) stop();
  });
  update();
  const onclick = () => viewer.measure();
  const measure = el(
    "button",
    { type: "button", class: "text", title: "Draw a few frames and time them", onclick },
    "Time it",
  );
  const section = createSection("Numbers", list);
  section.querySelector("h2")?.append(measure);
  return section;
}

type Row = [name: string, value: string];

function costs(viewer: Viewer): Row[] {
  const bytes = viewer.fields.reduce((sum, field) => sum + field.bytes, 0);
  const rows: Row[] = [["Frame", frameTime(viewer)]];
  if (viewer.fields.length > 0)
    rows.push(
      ["Multiply-adds", `${grouped(Math.round(viewer.learned?.macs ?? 0))} / px`],
      ["Learned data", size(bytes)],
      ["On the GPU", size(viewer.fields.reduce((sum, field) => sum + field.memory, 0))],
    );
  const map = new Set(viewer.learned?.pictures.filter(({ name }) => name === "light map").map((p) => p.bytes));
  if (map.size > 0) rows.push(["Light map", size([...map].reduce((a, b) => a + b))]);
  rows.push(["File", size(viewer.fileBytes)]);
  return rows;
}

/** The frame time changes with every frame; the rest of the list does not. */
function updateTime(viewer: Viewer, list: HTMLElement): void {
  const value = list.querySelector("dd");
  if (value) value.textContent = frameTime(viewer);
}

function frameTime(viewer: Viewer): string {
  const ms = viewer.frameMilliseconds;
  if (ms === null) return "–";
  return `${ms < 10 ? ms.toFixed(1) : ms.toFixed(0)} ms · ${grouped(Math.round(1000 / ms))} fps`;
}

function thisView(viewer: Viewer): Row[] {
  if (!viewer.comparison) return [];
  const { relativeError, psnr } = viewer.comparison;
  return [
    ["This view, error", percent(relativeError)],
    ["This view, PSNR", decibels(psnr)],
  ];
}

function report(viewer: Viewer): Row[] {
  return REPORT.flatMap(([name, label, write]): Row[] => {
    const value = viewer.page.report[name];
    return value === undefined ? [] : [[label, write(value)]];
  });
}

function decibels(x: number): string {
  return `${x.toFixed(1)} dB`;
}

function percent(x: number): string {
  return `${(100 * x).toFixed(x < 0.1 ? 1 : 0)} %`;
}

function seconds(x: number): string {
  return x < 120 ? `${x.toFixed(0)} s` : `${(x / 60).toFixed(0)} min`;
}

function grouped(x: number): string {
  return x.toLocaleString("en-GB").replaceAll(",", "\u202f");
}

export function size(bytes: number): string {
  if (bytes < 1e6) return `${(bytes / 1e3).toFixed(bytes < 1e4 ? 1 : 0)} kB`;
  return `${(bytes / 1e6).toFixed(1)} MB`;
}
