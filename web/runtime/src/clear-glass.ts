/** Which surfaces show what lies behind them. */

/** Glass is clear with more transmission and less roughness than these (format/FORMAT.md, "Glass"). */
const CLEAR_TRANSMISSION = 0.5;
const CLEAR_ROUGHNESS = 0.1;

/** The engine draws what lies behind clear glass, and glass casts no shadow. In files without `glass` it has no learned light of its own. */
export function isClear(transmission: number, roughness: number): boolean {
  return transmission > CLEAR_TRANSMISSION && roughness < CLEAR_ROUGHNESS;
}
