/** Exposure of the page of a probe volume. */

// Share of the probes that are darker than the light that is metered: most probes of a scene may stand outside it, in the dark.
const DARKER = 0.9;
// Radiance that a white surface in the metered light is shown with: bright, below where the tone curve washes colours out.
const SHOWN = 0.6;
const LEAST = 1e-9;

/** Factor from radiance to what is shown, from the mean irradiance of each probe. */
export function meteredExposure(irradiances: readonly number[]): number {
  const sorted = [...irradiances].sort((a, b) => a - b);
  const metered = sorted[Math.floor(DARKER * sorted.length)] ?? 1;
  return (SHOWN * Math.PI) / Math.max(metered, LEAST);
}
