/** The option `lights=` of the page's address: a number of lamps, or a list of them. */

import { MAX_LAMPS } from "lightwell";

/** One lamp of the list; what is absent is chosen by the page. */
export interface LightOption {
  /** Position in metres, or direction to a sun. */
  readonly value?: readonly [number, number, number];
  /** sRGB, as `#rrggbb`. */
  readonly color?: string;
  readonly intensity?: number;
}

const MAX_INTENSITY = 1e12;

/** `3`, or `x,y,z[,rrggbb[,intensity]]` for every lamp, separated by `;`. Anything malformed is as if it were absent. */
export function readLights(text: string | null): readonly LightOption[] {
  if (!text) return [];
  if (/^\d$/.test(text)) return Array.from({ length: Math.min(Number(text), MAX_LAMPS) }, () => ({}));
  const lights = text.split(";").map(readLight);
  return lights.every((light) => light !== null) ? lights.slice(0, MAX_LAMPS) : [];
}

function readLight(text: string): LightOption | null {
  const parts = text.split(",").map((part) => part.trim());
  const [x, y, z, strength = 1] = [...parts.slice(0, 3), ...parts.slice(4, 5)].map(readNumber);
  if (parts.length < 3 || parts.length > 5) return null;
  if (![x, y, z, strength].every(Number.isFinite) || strength < 0 || strength > MAX_INTENSITY) return null;
  if (parts.length > 3 && !/^[0-9a-f]{6}$/i.test(parts[3]!)) return null;
  return {
    value: [x!, y!, z!],
    ...(parts.length > 3 ? { color: `#${parts[3]}` } : {}),
    ...(parts.length > 4 ? { intensity: strength } : {}),
  };
}

/** A number; NaN when the text is none. */
function readNumber(text: string): number {
  return text === "" ? Number.NaN : Number(text);
}
