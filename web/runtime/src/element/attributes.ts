/** What the attributes of `<lightwell-viewer>` say. */

import { ACESFilmicToneMapping, AgXToneMapping, NeutralToneMapping, NoToneMapping, type ToneMapping, Vector3 } from "three";

const TONE_MAPPINGS: Readonly<Record<string, ToneMapping>> = {
  agx: AgXToneMapping,
  aces: ACESFilmicToneMapping,
  neutral: NeutralToneMapping,
  none: NoToneMapping,
};

/** The tone mapping of a name; AgX for any other. */
export function toneMappingOf(name: string | null): ToneMapping {
  return TONE_MAPPINGS[name ?? "agx"] ?? AgXToneMapping;
}

/** A number above 0; null for anything else. */
export function positive(text: string | null): number | null {
  const value = Number(text ?? Number.NaN);
  return value > 0 && Number.isFinite(value) ? value : null;
}

/** A number from 0 to 1, others brought into it; null for anything else. */
export function share(text: string | null): number | null {
  const value = text?.trim() ? Number(text) : Number.NaN;
  return Number.isNaN(value) ? null : Math.min(Math.max(value, 0), 1);
}

/** `x y z / x y z` as vectors; null when it is anything else. */
export function vectors(text: string | null): Vector3[] | null {
  const found = (text ?? "").split("/").map((part) => part.trim().split(/[\s,]+/).map(Number));
  const fine = found.every((numbers) => numbers.length === 3 && numbers.every(Number.isFinite));
  return fine ? found.map((numbers) => new Vector3().fromArray(numbers)) : null;
}
