/** Flying by keys: arrows go ahead, back and turn, with Shift aside; page up and down rise and sink. */

import type { Viewer } from "../viewer.ts";

/** Share of the scene's diagonal, and radians, per second. */
const SPEED = 0.22;
const TURN = 1.1;
/** Longest step, seconds: a slow frame must not throw the camera through a wall. */
const MAX_STEP = 0.1;

const KEYS = ["ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", "PageUp", "PageDown"] as const;
type Key = (typeof KEYS)[number];

/** Fly while keys are held and nothing that takes keys itself has the focus. */
export function listenToFlight(viewer: Viewer): void {
  const held = new Set<Key>();
  let [aside, before, requested] = [false, 0, 0];
  const step = (now: number) => {
    // A frame begins before the key that is heard in it.
    const seconds = Math.min(Math.max((now - before) / 1000, 0), MAX_STEP);
    before = now;
    const axis = (up: Key, down: Key) => Number(held.has(up)) - Number(held.has(down));
    const side = axis("ArrowRight", "ArrowLeft");
    const move = [aside ? side : 0, axis("PageUp", "PageDown"), axis("ArrowUp", "ArrowDown")] as const;
    viewer.fly(
      move.map((x) => x * SPEED * seconds) as unknown as readonly [number, number, number],
      aside ? 0 : -side * TURN * seconds,
    );
    requested = held.size > 0 ? requestAnimationFrame(step) : 0;
  };
  addEventListener("keydown", (event) => {
    // macOS tells of no key that is let go while this one is down.
    if (event.key === "Meta") held.clear();
    const key = KEYS.find((name) => name === event.key);
    if (!key || event.ctrlKey || event.metaKey || event.altKey || !isPicture(event.target)) return;
    event.preventDefault();
    held.add(key);
    aside = event.shiftKey;
    if (requested !== 0) return;
    before = performance.now();
    requested = requestAnimationFrame(step);
  });
  addEventListener("keyup", (event) => {
    held.delete(event.key as Key);
    aside = event.shiftKey;
  });
  addEventListener("blur", () => held.clear());
}

/** Whether keys belong to the picture: nothing has the focus, or the canvas has it. */
function isPicture(target: EventTarget | null): boolean {
  return target === document.body || target instanceof HTMLCanvasElement;
}
