/** The scene's own lamps as switches: each has a dimmer and a colour, and its shining surfaces follow. */

import { Color, type ColorRepresentation, type Light, type Material, Mesh, MeshStandardMaterial, type Object3D } from "three";
import { fail, list, number, record, text, type Vec3, vec3 } from "./checks.ts";
import type { Lightmap } from "./lightmap.ts";
import type { Taken } from "./own-lights.ts";
import { copyOf } from "./material-copy.ts";

/** A group of lamps as a file declares it. */
export interface LampRecord {
  readonly name: string;
  /** Names of the nodes whose emission or light follows it. */
  readonly nodes: readonly string[];
  /** First position of the dimmer; 1 is the light as it was baked. */
  readonly intensity: number;
  /** First colour, linear sRGB: a factor. */
  readonly color: Vec3;
}

/** Largest number of groups. */
export const MAX_SWITCHES = 64;
const MAX_NODES = 65_536;
const MAX_INTENSITY = 1e6;

/** Read `extension.lamps`. */
export function readLamps(value: unknown, where: string): LampRecord[] {
  if (value === undefined) return [];
  const lamps = list(value, where, MAX_SWITCHES).map((entry, i) => readLamp(entry, `${where}[${i}]`));
  if (lamps.length === 0) fail(where, "at least one lamp");
  if (new Set(lamps.map(({ name }) => name)).size < lamps.length) fail(where, "lamps of different names");
  return lamps;
}

function readLamp(value: unknown, where: string): LampRecord {
  const entry = record(value, where);
  const color = vec3(entry.color, `${where}.color`);
  if (color.some((x) => x < 0)) fail(`${where}.color`, "no negative number");
  return {
    name: text(entry.name, `${where}.name`),
    nodes: list(entry.nodes, `${where}.nodes`, MAX_NODES).map((node, i) => text(node, `${where}.nodes[${i}]`)),
    intensity: number(entry.intensity, `${where}.intensity`, 0, MAX_INTENSITY),
    color,
  };
}

/** What a lamp is set to: a position of its dimmer, or that and a colour. Numbers of a colour are linear sRGB. */
export type LampSetting = number | { readonly intensity?: number; readonly color?: ColorRepresentation | Vec3 };

/** One group of lamps: change `intensity` and `color` at any time. */
export class LampSwitch {
  readonly record: LampRecord;
  /** 0 is off, 1 as baked. */
  intensity: number;
  /** Factor of the lamps' own colour. */
  readonly color: Color;

  constructor(lamp: LampRecord) {
    this.record = lamp;
    this.intensity = lamp.intensity;
    this.color = new Color(...lamp.color);
  }

  get name(): string {
    return this.record.name;
  }

  set(setting: LampSetting): void {
    const { intensity, color } = typeof setting === "number" ? { intensity: setting, color: undefined } : setting;
    if (intensity !== undefined) this.intensity = Math.min(Math.max(intensity, 0), MAX_INTENSITY) || 0;
    if (Array.isArray(color)) this.color.setRGB(...(color as [number, number, number]));
    else if (color !== undefined) this.color.set(color as ColorRepresentation);
  }

  reset(): void {
    this.set({ intensity: this.record.intensity, color: this.record.color });
  }
}

/** A surface that shines, with a material of its own while it follows a lamp. */
interface Follower {
  readonly lamp: LampSwitch;
  readonly mesh: Mesh;
  readonly before: Mesh["material"];
  readonly shining: readonly { readonly material: MeshStandardMaterial; readonly emissive: Color }[];
}

/** What lights of the file were when they were first met: colour times intensity. */
const AT_REST = new WeakMap<Light, Color>();

/** All groups of a scene. */
export class Switches {
  readonly all: readonly LampSwitch[];
  /** What each group is multiplied by: red of all groups, then green, then blue. */
  readonly factors: Float32Array;
  private followers: Follower[] = [];
  /** Lights of three.js that belong to a group: what an application makes of them, the group follows. */
  private lights = new Map<LampSwitch, Taken[]>();
  private lightmaps = new Map<Material, Lightmap>();
  private readonly owners = new Map<string, LampSwitch>();

  constructor(lamps: readonly LampRecord[]) {
    this.all = lamps.map((lamp) => new LampSwitch(lamp));
    this.factors = new Float32Array(3 * lamps.length);
    for (const lamp of this.all) for (const node of lamp.record.nodes) this.owners.set(node, lamp);
    this.follow();
  }

  /** Set a lamp by its name. */
  set(name: string, setting: LampSetting): void {
    const lamp = this.all.find((other) => other.name === name);
    if (!lamp) {
      const names = this.all.map((other) => `'${other.name}'`).join(", ") || "none";
      throw new Error(`lightwell: expected a lamp of the file (${names}), found '${name}'; use one of these names`);
    }
    lamp.set(setting);
  }

  /** The group that an object under the root belongs to; null for none. */
  of(object: Object3D | null): LampSwitch | null {
    for (let node = object; node; node = node.parent) {
      const found = this.owners.get((node.userData.name as string | undefined) ?? node.name);
      if (found) return found;
    }
    return null;
  }

  /** Give surfaces that shine materials of their own, which follow their lamp; lamps follow the lights that were taken away. */
  attach(root: Object3D, lightmaps: Map<Material, Lightmap>, taken: readonly Taken[] = []): void {
    if (this.all.length === 0) return;
    this.lightmaps = lightmaps;
    for (const one of taken) {
      const lamp = this.of(one.stand);
      if (!lamp) continue;
      this.lights.set(lamp, [...(this.lights.get(lamp) ?? []), one]);
      if (!AT_REST.has(one.light)) AT_REST.set(one.light, one.light.color.clone().multiplyScalar(one.light.intensity));
    }
    root.traverse((object) => {
      const lamp = object instanceof Mesh ? this.of(object) : null;
      if (lamp) this.adopt(object as Mesh, lamp);
    });
  }

  private adopt(mesh: Mesh, lamp: LampSwitch): void {
    const { lightmaps } = this;
    const shining: { material: MeshStandardMaterial; emissive: Color }[] = [];
    const copies = [mesh.material].flat().map((material) => {
      if (!(material instanceof MeshStandardMaterial) || material.emissive.getHex() === 0) return material;
      const copy = copyOf(material, lightmaps);
      shining.push({ material: copy, emissive: copy.emissive.clone() });
      return copy;
    });
    if (shining.length === 0) return;
    this.followers.push({ lamp, mesh, before: mesh.material, shining });
    mesh.material = Array.isArray(mesh.material) ? copies : copies[0]!;
  }

  /** Give the materials back. */
  detach(): void {
    for (const { mesh, before, shining } of this.followers) {
      // What its owner has given it since stays.
      if (shining.some(({ material }) => [mesh.material].flat().includes(material))) mesh.material = before;
      for (const { material } of shining) {
        this.lightmaps.delete(material);
        material.dispose();
      }
    }
    this.followers = [];
    this.lights.clear();
  }

  /** Colour times intensity of a group, and what an application made of its lights. */
  private gainOf(lamp: LampSwitch): Color {
    const [now, rest] = [new Color(0), new Color(0)];
    for (const { light, stand } of this.lights.get(lamp) ?? []) {
      rest.add(AT_REST.get(light)!);
      if (light.visible && stand.visible) now.add(light.color.clone().multiplyScalar(light.intensity));
    }
    const share = (channel: "r" | "g" | "b") => (rest[channel] > 0 ? Math.max(now[channel] / rest[channel], 0) || 0 : 1);
    return lamp.color.clone().multiplyScalar(lamp.intensity).multiply(now.setRGB(share("r"), share("g"), share("b")));
  }

  /** Bring factors and surfaces up to date. */
  follow(): void {
    const count = this.all.length;
    const gains = new Map(this.all.map((lamp) => [lamp, this.gainOf(lamp)]));
    [...gains.values()].forEach((gain, i) => {
      for (const [channel, value] of gain.toArray().entries()) this.factors[channel * count + i] = value as number;
    });
    for (const { lamp, shining } of this.followers) {
      for (const { material, emissive } of shining) material.emissive.copy(emissive).multiply(gains.get(lamp)!);
    }
  }
}

/** `desk:0.3;bed:0:ffcc88` as settings by name: dimmer, and a colour in sRGB digits. Anything malformed is left out. */
export function readLampSettings(given: string | null): ReadonlyMap<string, LampSetting> {
  const found = new Map<string, LampSetting>();
  for (const part of (given ?? "").split(";").slice(0, MAX_SWITCHES)) {
    const [name = "", strength = "", color] = part.split(":");
    const intensity = strength.trim() === "" ? Number.NaN : Number(strength);
    if (!name.trim() || !(intensity >= 0 && intensity <= MAX_INTENSITY)) continue;
    if (color !== undefined && !/^[0-9a-f]{6}$/i.test(color)) continue;
    found.set(decoded(name.trim()), color === undefined ? intensity : { intensity, color: `#${color}` });
  }
  return found;
}

/** The same text for lamps that differ from the file; empty when none does. */
export function lampSettingsText(lamps: readonly LampSwitch[]): string {
  return lamps
    .filter(({ intensity, color, record: { intensity: first, color: tint } }) => {
      return intensity !== first || color.toArray().some((x, i) => Math.abs((x as number) - tint[i]!) > 1e-3);
    })
    .map(({ name, intensity, color, record: { color: tint } }) => {
      const tinted = color.toArray().some((x, i) => Math.abs((x as number) - tint[i]!) > 1e-3);
      return `${encodeURIComponent(name)}:${Number(intensity.toPrecision(4))}${tinted ? `:${color.getHexString()}` : ""}`;
    })
    .join(";");
}

function decoded(name: string): string {
  try {
    return decodeURIComponent(name);
  } catch {
    return name;
  }
}
