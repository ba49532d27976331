/** Starts the page. */

import "./style.css";
import { findAsset, type LoadedAsset } from "./asset.ts";
import { automate } from "./automation.ts";
import { answerFrame } from "./frame-messages.ts";
import { readOptions } from "./options.ts";
import { applyState } from "./page-state.ts";
import { copyLink, createCopyLink } from "./ui/copy-link.ts";
import { el } from "./ui/dom.ts";
import { listenToFlight } from "./ui/fly.ts";
import { createHelp } from "./ui/help.ts";
import { size } from "./ui/numbers.ts";
import { listenToKeys } from "./ui/keys.ts";
import { LampHandle } from "./ui/lamp-handle.ts";
import { createLegends } from "./ui/legend.ts";
import { createModeBar } from "./ui/mode-bar.ts";
import { createNotices } from "./ui/notices.ts";
import { listenToObject } from "./ui/object-controls.ts";
import { createPanel } from "./ui/panel.ts";
import { Shortcuts } from "./ui/shortcuts.ts";
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
  const shortcuts = new Shortcuts(options.keys);
  const help = createHelp(viewer, shortcuts);
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
  // Lamps last: the line of the split must not cover their handles.
  root.append(createSplitHandle(viewer), lamps, header, bottom, panel, help.element);
  panel.prepend(help.button, createCopyLink(viewer));
  listenToFlight(viewer);
  listenToObject(viewer);
  listenToKeys(viewer, shortcuts, {
    help: help.toggle,
    link: () => void copyLink(viewer),
    panel: () => panel.querySelector<HTMLButtonElement>("[aria-controls]")?.click(),
    light: () => lamps.querySelector("button")?.focus(),
  });
}

/** Counts files that were asked for: one that was overtaken is not shown. */
let asked = 0;

/** Show a file; resolves with whether no other one has taken its place. */
async function show(viewer: Viewer, work: Promise<LoadedAsset | null>): Promise<boolean> {
  const turn = ++asked;
  status.replaceChildren("Preparing the light…");
  status.hidden = false;
  const asset = await work.catch((error: unknown) => {
    if (turn === asked) throw error;
    return null;
  });
  if (turn !== asked) return false;
  if (!asset) {
    status.replaceChildren(createWelcome((file) => void show(viewer, file).catch(explain)));
    return true;
  }
  status.replaceChildren("Preparing the light…");
  // From the first frame on, which has direct light alone, the page can be used.
  const stop = viewer.on("loaded", () => {
    status.hidden = true;
    root.classList.add("loaded");
  });
  await viewer.load(asset).finally(stop);
  return turn === asked;
}

/** Says how much of the file has come. */
function sayProgress(loaded: number, total: number): void {
  const of = total >= loaded && total > 0 ? ` of ${size(total)}` : "";
  const bar = el("progress", total > 0 ? { max: total, value: loaded, "aria-label": "Download" } : { "aria-label": "Download" });
  status.replaceChildren(`Loading ${size(loaded)}${of}`, bar);
}

/** What the address asks for; a visitor first sees what the learned light adds. */
function applyOptions(viewer: Viewer): Promise<void> {
  const { mode, ui } = options;
  return applyState(viewer, { ...options, mode: mode ?? (ui && viewer.fields.length > 0 ? "split" : null) });
}

async function start(): Promise<void> {
  const viewer = createViewer();
  if (!viewer) return;
  root.classList.toggle("bare", !options.ui);
  if (options.size) canvas.style.cssText = `width:${options.size[0]}px;height:${options.size[1]}px`;
  root.append(createNotices(viewer));
  if (options.ui) addControls(viewer);
  acceptDrops((file) => void show(viewer, file).catch(explain));
  const ready = show(viewer, findAsset(options, sayProgress)).then((shown) => (shown ? applyOptions(viewer) : undefined));
  automate(viewer, ready);
  answerFrame(viewer, ready);
  await ready.catch(explain);
}

void start();
