/** Starts the page. */

import "./style.css";
import { Color, Vector3 } from "three";
import { findAsset, type LoadedAsset } from "./asset.ts";
import { automate } from "./automation.ts";
import { readOptions } from "./options.ts";
import { el } from "./ui/dom.ts";
import { createHelp } from "./ui/help.ts";
import { listenToKeys } from "./ui/keys.ts";
import { LampHandle } from "./ui/lamp-handle.ts";
import { createLegends } from "./ui/legend.ts";
import { createModeBar } from "./ui/mode-bar.ts";
import { createNotices } from "./ui/notices.ts";
import { createPanel } from "./ui/panel.ts";
import { createSplitHandle } from "./ui/split-handle.ts";
import { createViewsStrip } from "./ui/views-strip.ts";
import { acceptDrops, createWelcome } from "./ui/welcome.ts";
import { Viewer } from "./viewer.ts";

const root = document.getElementById("lightwell")!;
const canvas = document.getElementById("stage") as HTMLCanvasElement;
const options = readOptions(location.search);
const status = el("div", { class: "status", role: "status" }, "Preparing the light…");
root.append(status);

/** Says on the page why nothing is shown. */
function explain(error: unknown): void {
  const message = error instanceof Error ? error.message : String(error);
  status.replaceChildren(el("strong", {}, "This scene cannot be shown."), el("span", {}, message));
  status.setAttribute("role", "alert");
  status.hidden = false;
}

function createViewer(): Viewer | null {
  try {
    return new Viewer(canvas, options);
  } catch {
    explain("This browser offers no WebGL 2, which the page draws with.");
    return null;
  }
}

/** Controls around the picture. */
function addControls(viewer: Viewer): void {
  const heading = el("h1");
  const help = createHelp();
  const panel = createPanel(viewer);
  const lamps = el("div", { class: "lamps" });
  let handles: LampHandle[] = [];
  viewer.on("loaded", () => {
    heading.textContent = viewer.title;
    document.title = `${viewer.title} · lightwell`;
    links.replaceChildren(...viewer.page.links.map(({ href, text }) => el("a", { href }, text)));
  });
  viewer.on("lamps", () => {
    const points = [...viewer.lamps.keys()].filter((index) => viewer.lamps[index]!.variable.kind === "point");
    handles = points.map((index) => new LampHandle(viewer, index));
    lamps.replaceChildren(...handles.map((handle) => handle.element));
  });
  viewer.on("frame", () => {
    for (const handle of handles) handle.update();
  });
  const links = el("nav", { class: "links" });
  const header = el("header", {}, heading, el("span", { class: "wordmark" }, "lightwell"), links);
  const bottom = el("footer", {}, ...createLegends(viewer), createModeBar(viewer), createViewsStrip(viewer));
  root.append(lamps, createSplitHandle(viewer), header, bottom, panel, help.element);
  panel.prepend(help.button);
  listenToKeys(viewer, {
    help: help.toggle,
    panel: () => panel.querySelector<HTMLButtonElement>("[aria-controls]")?.click(),
    light: () => lamps.querySelector("button")?.focus(),
  });
}

async function show(viewer: Viewer, work: Promise<LoadedAsset | null>): Promise<void> {
  status.replaceChildren("Preparing the light…");
  status.hidden = false;
  const asset = await work;
  if (!asset) {
    status.replaceChildren(createWelcome((file) => void show(viewer, file).catch(explain)));
    return;
  }
  // From the first frame on, which has direct light alone, the page can be used.
  const stop = viewer.on("loaded", () => {
    status.hidden = true;
    root.classList.add("loaded");
  });
  await viewer.load(asset).finally(stop);
}

/** Lamps that the address asks for. */
function applyLights(viewer: Viewer): void {
  options.lights.forEach(({ value, color, intensity }, index) => {
    const lamp = viewer.lamps[index] ? index : viewer.desk.add();
    if (lamp < 0) return;
    if (value) viewer.desk.move(lamp, new Vector3(...value));
    if (color) viewer.desk.setColor(lamp, new Color(color));
    if (intensity !== undefined) viewer.desk.setIntensity(lamp, intensity);
  });
}

/** Mode, view and lamps that the address asks for. */
async function applyOptions(viewer: Viewer): Promise<void> {
  if (options.view !== null && viewer.page.views[options.view]) {
    viewer.setView(options.view);
    if (viewer.page.views[options.view]!.reference) await viewer.reference(options.view);
  }
  applyLights(viewer);
  if (options.mode) viewer.setMode(options.mode);
  // What the learned light adds is what a visitor should see first.
  else if (options.ui && viewer.fields.length > 0) viewer.setMode("split");
  if (viewer.view !== null && viewer.page.views[viewer.view]?.reference) await viewer.reference(viewer.view);
  await viewer.prepared();
  viewer.renderOnce();
}

async function start(): Promise<void> {
  const viewer = createViewer();
  if (!viewer) return;
  root.classList.toggle("bare", !options.ui);
  if (options.size) canvas.style.cssText = `width:${options.size[0]}px;height:${options.size[1]}px`;
  root.append(createNotices(viewer));
  if (options.ui) addControls(viewer);
  acceptDrops((file) => void show(viewer, file).catch(explain));
  const ready = show(viewer, findAsset(options)).then(() => applyOptions(viewer));
  automate(viewer, ready);
  await ready.catch(explain);
}

void start();
