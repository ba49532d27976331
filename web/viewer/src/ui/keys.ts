/** Keyboard shortcuts of the page. */

import { MODE_TEXTS, MODES } from "../modes.ts";
import type { Viewer } from "../viewer.ts";
import type { Shortcuts } from "./shortcuts.ts";

/** Things that keys do beyond the viewer. */
export interface KeyActions {
  help(): void;
  panel(): void;
  light(): void;
  link(): void;
}

/** Listen while shortcuts are on; help opens in any case, for they are switched there. */
export function listenToKeys(viewer: Viewer, shortcuts: Shortcuts, actions: KeyActions): void {
  addEventListener("keydown", (event) => {
    if (event.key !== "?" && !shortcuts.on) return;
    if (event.ctrlKey || event.metaKey || event.altKey || isEntry(event.target)) return;
    const mode = MODES.find((name) => MODE_TEXTS[name].key === event.key);
    if (mode) return viewer.setMode(mode);
    const action = {
      "?": actions.help,
      p: actions.panel,
      l: actions.light,
      c: actions.link,
      h: () => viewer.goHome(),
      s: () => viewer.nextAgainst(),
      f: () => void viewer.lens.set(!viewer.lens.on),
      r: () => viewer.setHalf(!viewer.half),
      "+": () => viewer.lampController.add(),
      "=": () => viewer.lampController.add(),
      "-": () => viewer.lampController.remove(viewer.lamps.length - 1),
      v: () => viewer.setView(((viewer.view ?? -1) + 1) % Math.max(viewer.page.views.length, 1)),
    }[event.key.toLowerCase()];
    action?.();
  });
}

/** Whether keys belong to what has focus. */
function isEntry(target: EventTarget | null): boolean {
  return (
    target instanceof HTMLSelectElement || (target instanceof HTMLInputElement && target.type !== "range")
  );
}
