/** A slider for each node or clip that moves: a door in degrees, a sliding one in metres, a clip in per cent. */

import type { Viewer } from "../viewer.ts";
import { createSection, createSlider } from "./controls.ts";

const SHOWN = {
  degrees: (value: number) => `${value.toFixed(0)}°`,
  metres: (value: number) => `${value.toFixed(2)} m`,
  share: (value: number) => `${(100 * value).toFixed(0)} %`,
};
/** Steps of a slider from end to end. */
const STEPS = 500;

/** Controls of all movers; null where everything stands still. */
export function createMovers(viewer: Viewer): HTMLElement | null {
  const movers = viewer.learned?.movers ?? [];
  if (movers.length === 0) return null;
  const rows = movers.map((mover) => {
    const { range, unit } = mover.record;
    const [low, high] = [Math.min(...range), Math.max(...range)];
    const show = (value: number) => SHOWN[unit](value);
    const slider = createSlider(mover.name.replaceAll("_", " "), [low, high, (high - low) / STEPS], show, (value) => viewer.setMover(mover.name, value));
    return { element: slider.element, update: () => slider.set(mover.value) };
  });
  const update = () => rows.forEach((row) => row.update());
  const stops = [viewer.on("change", update)];
  const stop = viewer.on("loaded", () => [...stops, stop].forEach((end) => end()));
  update();
  return createSection("Moving parts", ...rows.map(({ element }) => element));
}
