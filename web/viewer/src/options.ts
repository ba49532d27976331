/** Options of the page's address, for tests, screenshots and links. */

import { type LampSetting, readClock, readLampSettings, readMoverValues } from "lightwell";
import { readLights, type LightOption } from "./light-options.ts";
import { AGAINST, type Against, MODES, type Mode } from "./modes.ts";
import { TONE_MAPPINGS, type ToneMappingName } from "./tone-mapping.ts";

/** What `?size=640x360&mode=learned&view=0&ui=0&tonemap=agx…` may say; absent means the page's default. */
export interface Options {
  /** Address of a GLB to load when the page carries none. */
  readonly asset: string | null;
  /** Address of page data (JSON) that goes with `asset`. */
  readonly page: string | null;
  /** Fixed canvas size in pixels. */
  readonly size: readonly [number, number] | null;
  readonly mode: Mode | null;
  /** What is to the left in split mode. */
  readonly against: Against | null;
  /** Where the left picture ends in split mode, 0 … 1. */
  readonly split: number | null;
  /** Saved view to start from, counted from 0. */
  readonly view: number | null;
  /** Eye and target in metres, and the vertical field of view in degrees. */
  readonly camera: readonly number[] | null;
  /** Whether controls are shown. */
  readonly ui: boolean;
  readonly toneMapping: ToneMappingName | null;
  /** Linear factor before tone mapping. */
  readonly exposure: number | null;
  readonly dither: boolean;
  readonly weights: "inline" | "texture" | null;
  /** Samples per pixel of the rasteriser: 0 or 4. */
  readonly samples: number;
  /** Lamps to start with, the declared ones first; empty for those alone. */
  readonly lights: readonly LightOption[];
  /** Time of day, hours. */
  readonly day: number | null;
  /** Turn of the environment map, degrees. */
  readonly rotation: number | null;
  /** Settings of the scene's own lamps by name: `desk:0.3;bed:0:ffcc88`. */
  readonly lamps: ReadonlyMap<string, LampSetting>;
  /** Values of the nodes that move by name: `Door:45`. */
  readonly movers: ReadonlyMap<string, number>;
  /** Whether the learned light is evaluated at half resolution. */
  readonly half: boolean;
  /** Whether single keys are shortcuts; null leaves it to the visitor. */
  readonly keys: boolean | null;
}

const MAX_SIDE = 8192;
const MAX_DISTANCE = 1e6;
/** Degrees. */
const FIELD_OF_VIEW = 45;

/** Parse the query string; anything malformed is as if it were absent. */
export function readOptions(search: string): Options {
  const query = new URLSearchParams(search);
  const weights = query.get("weights");
  return {
    asset: query.get("asset"),
    page: query.get("page"),
    size: readSize(query.get("size")),
    mode: oneOf(query.get("mode"), MODES),
    against: oneOf(query.get("against"), AGAINST),
    split: readNumber(query.get("split"), 0, 1),
    view: readNumber(query.get("view"), 0, 10_000),
    camera: readCamera(query.get("camera")),
    ui: query.get("ui") !== "0",
    toneMapping: oneOf(query.get("tonemap"), TONE_MAPPINGS),
    exposure: readNumber(query.get("exposure"), 1e-6, 1e6),
    dither: query.get("dither") !== "0",
    weights: weights === "inline" || weights === "texture" ? weights : null,
    samples: query.get("samples") === "0" ? 0 : 4,
    lights: readLights(query.get("lights")),
    day: readClock(query.get("day") ?? ""),
    rotation: readNumber(query.get("rotation"), -360, 360),
    lamps: readLampSettings(query.get("lamps")),
    movers: readMoverValues(query.get("movers")),
    half: query.get("half") === "1",
    keys: query.has("keys") ? query.get("keys") !== "0" : null,
  };
}

function readSize(text: string | null): readonly [number, number] | null {
  const match = /^(\d{1,4})x(\d{1,4})$/.exec(text ?? "");
  if (!match) return null;
  const [width, height] = [Number(match[1]), Number(match[2])];
  return width >= 1 && height >= 1 && width <= MAX_SIDE && height <= MAX_SIDE ? [width, height] : null;
}

/** `x,y,z,x,y,z[,degrees]`: eye, target, field of view. */
function readCamera(text: string | null): readonly number[] | null {
  const numbers = (text ?? "").split(",").map((part) => (part.trim() === "" ? Number.NaN : Number(part)));
  const [fovY = FIELD_OF_VIEW] = numbers.slice(6);
  const fine = numbers.every((x) => Math.abs(x) <= MAX_DISTANCE) && (numbers.length === 6 || numbers.length === 7);
  const apart = Math.hypot(...[0, 1, 2].map((i) => numbers[i]! - numbers[i + 3]!)) > 0;
  return fine && apart && fovY >= 1 && fovY <= 170 ? [...numbers.slice(0, 6), fovY] : null;
}

function readNumber(text: string | null, low: number, high: number): number | null {
  const value = text === null || text === "" ? Number.NaN : Number(text);
  return value >= low && value <= high ? value : null;
}

function oneOf<T extends string>(text: string | null, names: readonly T[]): T | null {
  return names.find((name) => name === text) ?? null;
}
