/** The part of the page for the lens, which is loaded when it is first used. The build takes `packed-lens-part.ts` in its place. */

export type LensPart = typeof import("./lens-picture.ts");

export function loadLens(): Promise<LensPart> {
  return import("./lens-picture.ts");
}
