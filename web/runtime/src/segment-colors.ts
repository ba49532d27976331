/** The colours of a picture of segments. */

/** Colours of the first segments, sRGB: told apart by hue and by lightness, of like weight on a dark page. */
export const SEGMENT_COLORS = [
  "#5b8ff9",
  "#f6a04d",
  "#5ad8a6",
  "#e8684a",
  "#9270ca",
  "#f6d55c",
  "#6dc8ec",
  "#ff99c3",
  "#8aa34d",
  "#8f9bb3",
  "#c08552",
  "#2f9e8f",
] as const;

/** Pixels from stripe to stripe, along x. */
export const STRIPE_PERIOD = 12;

/** Components of a colour in linear sRGB. */
export function linearOf(hex: string): number[] {
  return [1, 3, 5].map((i) => {
    const x = Number.parseInt(hex.slice(i, i + 2), 16) / 255;
    return x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4;
  });
}
