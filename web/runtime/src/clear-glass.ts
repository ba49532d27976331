/** Which surfaces the engine draws without learned light. */

/** Glass is clear with more transmission and less roughness than these (format/FORMAT.md, "Clear glass"). */
const CLEAR_TRANSMISSION = 0.5;
const CLEAR_ROUGHNESS = 0.1;

/** Clear glass has no learned light of its own: what lies behind it has, and the engine draws that through it. */
export function isClear(transmission: number, roughness: number): boolean {
  return transmission > CLEAR_TRANSMISSION && roughness < CLEAR_ROUGHNESS;
}
