/** Animations of lamps: reads their channels from a file, and plays them on the switches. Loaded when a file may have some. */

import type { BufferAttribute } from "three";
import { fail } from "./checks.ts";
import type { GltfJson } from "./container.ts";
import { EXTENSION } from "./extension-name.ts";
import type { LampSetting, LampSwitch } from "./switches.ts";

/** An animation of lamps. */
export interface LampAnimation {
  readonly name: string;
  /** Seconds. */
  readonly duration: number;
}

/** How an animation is played. */
export interface PlayOptions {
  /** Again from the start, or stay at the end; true unless given. */
  readonly loop?: boolean;
}

type Path = "intensity" | "color";

interface LampTrack {
  readonly lamp: number;
  readonly path: Path;
  readonly spline: boolean;
  readonly step: boolean;
  readonly times: readonly number[];
  /** So many numbers a key, three times as many of a spline: arriving tangent, value, leaving tangent. */
  readonly values: readonly number[];
}

export interface LampClip extends LampAnimation {
  readonly tracks: readonly LampTrack[];
}

/** Most animations of lamps, and most keys in all of them: limits against hostile files. */
const MAX_CLIPS = 64;
const MAX_KEYS = 1 << 20;
const PREFIX = `/extensions/${EXTENSION}/`;
const POINTER = /^lamps\/(0|[1-9]\d{0,3})\/(intensity|color)$/;
const WIDTH = { intensity: 1, color: 3 } as const;

/** A document whose form was checked. */
interface Animated {
  readonly name?: string;
  readonly channels: readonly { readonly sampler: number; readonly target: { readonly extensions?: any } }[];
  readonly samplers: readonly { readonly input: number; readonly output: number; readonly interpolation?: string }[];
}

/** Read the animations of a document that change its lamps. Throws a `FormatError` where one names a lamp that is not there, or has no proper keys. */
export async function readLampClips(json: GltfJson, lamps: number, accessor: (index: number) => Promise<BufferAttribute>): Promise<LampClip[]> {
  const clips: LampClip[] = [];
  const left = { keys: MAX_KEYS };
  for (const [i, { name, channels, samplers }] of ((json.animations ?? []) as Animated[]).entries()) {
    const tracks: LampTrack[] = [];
    for (const [k, { sampler, target }] of channels.entries()) {
      const pointer: unknown = target.extensions?.KHR_animation_pointer?.pointer;
      if (typeof pointer !== "string" || !pointer.startsWith(PREFIX)) continue;
      const where = `animations[${i}].channels[${k}]`;
      const [, lamp, path] = POINTER.exec(pointer.slice(PREFIX.length)) ?? fail(where, "a pointer to the intensity or color of a lamp");
      if (Number(lamp) >= lamps) fail(where, `one of ${lamps} lamps, found ${lamp}`);
      tracks.push(await readTrack(Number(lamp), path as Path, samplers[sampler]!, where, accessor, left));
    }
    if (tracks.length === 0) continue;
    if (clips.length === MAX_CLIPS) fail(`animations[${i}]`, `at most ${MAX_CLIPS} animations of lamps`);
    clips.push({ name: name ?? `clip ${i}`, duration: Math.max(...tracks.map(({ times }) => times.at(-1)!)), tracks });
  }
  return clips;
}

async function readTrack(
  lamp: number,
  path: Path,
  { input, output, interpolation }: Animated["samplers"][number],
  where: string,
  accessor: (index: number) => Promise<BufferAttribute>,
  left: { keys: number },
): Promise<LampTrack> {
  const [spline, step] = [interpolation === "CUBICSPLINE", interpolation === "STEP"];
  const [keys, found] = [await accessor(input), await accessor(output)];
  left.keys -= keys.count + found.count;
  if (left.keys < 0) fail(where, `at most ${MAX_KEYS} keys up to here`);
  if (keys.itemSize !== 1 || found.itemSize !== WIDTH[path] || found.count !== keys.count * (spline ? 3 : 1)) fail(where, "a value for each time");
  const [times, values] = [numbersOf(keys), numbersOf(found)];
  if (![...times, ...values].every(Number.isFinite)) fail(where, "finite numbers");
  if (times[0]! < 0 || times.some((time, i) => i > 0 && time <= times[i - 1]!)) fail(where, "times that increase");
  return { lamp, path, spline, step, times, values };
}

function numbersOf(attribute: BufferAttribute): number[] {
  const { count, itemSize } = attribute;
  return Array.from({ length: count * itemSize }, (_, i) => attribute.getComponent(Math.floor(i / itemSize), i % itemSize));
}

/** The values of a track at a time, seconds (glTF 2.0, appendix C); none is negative. */
export function valuesAt({ path, spline, step, times, values }: LampTrack, time: number): number[] {
  const width = WIDTH[path];
  const after = times.findIndex((other) => other > time);
  const first = Math.max((after < 0 ? times.length : after) - 1, 0);
  const second = Math.min(first + 1, times.length - 1);
  const length = times[second]! - times[first]!;
  const f = step || length === 0 ? 0 : Math.min(Math.max((time - times[first]!) / length, 0), 1);
  const [f2, f3] = [f * f, f * f * f];
  return Array.from({ length: width }, (_, c) => {
    const at = (key: number, part = 1) => values[(spline ? 3 * key + part : key) * width + c]!;
    if (!spline) return Math.max(at(first) * (1 - f) + at(second) * f, 0);
    const ends = (2 * f3 - 3 * f2 + 1) * at(first) + (3 * f2 - 2 * f3) * at(second);
    return Math.max(ends + length * ((f3 - 2 * f2 + f) * at(first, 2) + (f3 - f2) * at(second, 0)), 0);
  });
}

/** Plays animations on switches; where two change one lamp, the one that was started last does. */
export class LampPlayer {
  readonly clips: readonly LampClip[];
  private readonly switches: readonly LampSwitch[];
  /** Seconds since the start of each that plays; null before its first frame. */
  private readonly playing = new Map<LampClip, { loop: boolean; time: number | null }>();
  /** What the lamps were set to before, by lamp and path. */
  private readonly before = new Map<string, { readonly lamp: LampSwitch; readonly setting: LampSetting }>();
  private now = 0;

  constructor(clips: readonly LampClip[], switches: readonly LampSwitch[]) {
    this.clips = clips;
    this.switches = switches;
  }

  /** Start an animation, or start it again. */
  play(clip: LampClip, { loop = true }: PlayOptions = {}): void {
    this.playing.delete(clip);
    this.playing.set(clip, { loop, time: null });
    for (const track of clip.tracks) {
      const [key, lamp] = [keyOf(track), this.switches[track.lamp]!];
      const setting = track.path === "color" ? { color: lamp.color.clone() } : lamp.intensity;
      if (!this.before.has(key)) this.before.set(key, { lamp, setting });
    }
  }

  /** Stop an animation: its lamps are as they were before. */
  stop(clip: LampClip): void {
    if (!this.playing.delete(clip)) return;
    const driven = new Set([...this.playing.keys()].flatMap(({ tracks }) => tracks.map(keyOf)));
    for (const [key, { lamp, setting }] of this.before) {
      if (driven.has(key)) continue;
      lamp.set(setting);
      this.before.delete(key);
    }
  }

  /** Set the lamps to what they are so many seconds later; by the clock unless given. */
  advance(delta?: number): void {
    if (this.playing.size === 0) return;
    const now = performance.now() / 1000;
    const passed = delta ?? now - this.now;
    this.now = now;
    for (const [clip, state] of this.playing) {
      state.time = state.time === null ? 0 : state.time + passed;
      if (state.loop && clip.duration > 0) state.time %= clip.duration;
      for (const track of clip.tracks) {
        const found = valuesAt(track, Math.min(state.time, clip.duration));
        this.switches[track.lamp]!.set(track.path === "color" ? { color: found as [number, number, number] } : found[0]!);
      }
    }
  }
}

function keyOf({ lamp, path }: LampTrack): string {
  return `${lamp} ${path}`;
}
