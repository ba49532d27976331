/** What is shown, as the options of the page's address say it: for links, and for the page around a frame. */

import { clockText, lampSettingsText, moverValuesText, turningOf } from "lightwell";
import { Color, SRGBColorSpace, Vector3 } from "three";
import type { Options } from "./options.ts";
import { hourOf } from "./view-moment.ts";
import type { Viewer } from "./viewer.ts";

/** Options of the address that say what is shown, by name. */
export const STATE_NAMES = ["mode", "against", "split", "view", "camera", "day", "rotation", "lights", "lamps", "movers", "exposure", "tonemap", "half"] as const;

export type PageState = Partial<Record<(typeof STATE_NAMES)[number], string>>;

/** The part of the options that a state may change. */
export type ShownOptions = Pick<Options, "mode" | "against" | "split" | "view" | "camera" | "day" | "rotation" | "lights" | "lamps" | "movers" | "exposure" | "toneMapping" | "half">;

/** Digits that a link keeps: a tenth of a millimetre in a room. */
const DIGITS = 5;

const short = (numbers: readonly number[]): string => numbers.map((x) => String(Number(x.toPrecision(DIGITS)))).join(",");

/** The state of the page. */
export function stateOf(viewer: Viewer): PageState {
  const { mode, against, split, view, rig, exposure, toneMapping, half } = viewer;
  const { position, target, fovY } = rig.placed();
  const lights = viewer.lamps.map(({ value, color, intensity }) =>
    [short(value.toArray()), color.getHexString(SRGBColorSpace), short([intensity])].join(","),
  );
  const hour = hourOf(viewer.lamps);
  const map = turningOf(viewer.lamps);
  const movers = moverValuesText(viewer.learned?.movers ?? []);
  const lamps = lampSettingsText(viewer.learned?.switches ?? []);
  return {
    mode,
    ...(mode === "split" ? { against, split: short([split]) } : {}),
    ...(view === null ? { camera: short([...position, ...target, fovY]) } : { view: String(view) }),
    ...(hour === null ? {} : { day: clockText(hour) }),
    ...(map ? { rotation: short([map.angle]) } : {}),
    ...(lights.length > 0 ? { lights: lights.join(";") } : {}),
    ...(lamps ? { lamps } : {}),
    ...(movers ? { movers } : {}),
    exposure: short([exposure]),
    tonemap: toneMapping,
    ...(half ? { half: "1" } : {}),
  };
}

/** The address of the page with its state; other options stay. */
export function linkTo(viewer: Viewer, address: string): string {
  const url = new URL(address);
  for (const name of STATE_NAMES) url.searchParams.delete(name);
  for (const [name, value] of Object.entries(stateOf(viewer))) url.searchParams.set(name, value);
  // Commas and semicolons mean nothing else in a query.
  url.search = url.search.replaceAll("%2C", ",").replaceAll("%3B", ";").replaceAll("%3A", ":");
  return url.href;
}

/** Show what options ask for; what they leave out stays. Resolves when it is drawn. */
export async function applyState(viewer: Viewer, options: ShownOptions): Promise<void> {
  const { view, camera, mode, against, split, exposure, toneMapping } = options;
  if (view !== null && viewer.page.views[view]) {
    viewer.setView(view);
    if (viewer.page.views[view]!.reference) await viewer.reference(view);
  }
  if (camera) viewer.setCamera(camera.slice(0, 3), camera.slice(3, 6), camera[6]);
  if (exposure !== null) viewer.setExposure(exposure);
  if (toneMapping) viewer.setToneMapping(toneMapping);
  if (options.half !== viewer.half) viewer.setHalf(options.half);
  applyMoment(viewer, options);
  applyLights(viewer, options);
  applyLamps(viewer, options);
  for (const [name, value] of options.movers) {
    const mover = viewer.learned?.movers.find((other) => other.name === name);
    if (mover && short([mover.value]) !== short([value])) viewer.setMover(name, value);
  }
  if (against) viewer.setAgainst(against);
  if (split !== null) viewer.setSplit(split);
  if (mode) viewer.setMode(mode);
  if (viewer.view !== null && viewer.page.views[viewer.view]?.reference) await viewer.reference(viewer.view);
  await viewer.prepared();
  viewer.renderOnce();
}

/** The time of day and the turn of the map; a saved view that has its own keeps them while they agree. */
function applyMoment(viewer: Viewer, { day, rotation }: Pick<Options, "day" | "rotation">): void {
  const hour = hourOf(viewer.lamps);
  const map = turningOf(viewer.lamps);
  if (day !== null && (hour === null || clockText(day) !== clockText(hour))) viewer.setDay(day);
  if (rotation !== null && (!map || short([rotation]) !== short([map.angle]))) viewer.setEnvironmentRotation(rotation);
}

/** Lamps that are asked for; a saved view that has its own keeps them while they agree. */
function applyLights(viewer: Viewer, { lights }: Pick<Options, "lights">): void {
  lights.forEach(({ value, color, intensity }, index) => {
    const lamp = viewer.lamps[index] ? index : viewer.lampController.add();
    const shown = viewer.lamps[lamp];
    if (!shown) return;
    const place = value && new Vector3(...value);
    if (place && !near(place, shown.value)) viewer.lampController.move(lamp, place);
    if (color && `#${shown.color.getHexString(SRGBColorSpace)}` !== color) viewer.lampController.setColor(lamp, new Color(color));
    if (intensity !== undefined && short([intensity]) !== short([shown.intensity])) viewer.lampController.setIntensity(lamp, intensity);
  });
}

/** The scene's own lamps that are named; a saved view keeps its light where all are as they were. */
function applyLamps(viewer: Viewer, { lamps }: Pick<Options, "lamps">): void {
  for (const { name } of viewer.learned?.switches ?? []) {
    const setting = lamps.get(name);
    if (setting !== undefined) viewer.setLamp(name, setting);
  }
}

const near = (a: Vector3, b: Vector3): boolean => a.distanceTo(b) <= 10 ** (1 - DIGITS) * Math.max(1, b.length());
