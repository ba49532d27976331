/** What all engines draw in the tests, and how the test asks for it. */

export const SIZE = [160, 120] as const;
export const CAMERA = { position: [0.9, 1.3, 4.1] as const, target: [0, 0.9, 0] as const, fov: 36 };

export interface Shot {
  /** Place of the first lamp; where it was baked unless given. */
  readonly light: readonly [number, number, number] | null;
  readonly parts: { readonly raster: boolean; readonly indirect: boolean; readonly still: boolean };
}

/** The file that the page carries. */
export const glb = () => Uint8Array.from(atob(document.body.dataset.glb!), (c) => c.charCodeAt(0)).buffer;

/** Offer `shoot` to the test; pictures are RGBA bytes, last row first. */
export function publish(shoot: (shot: Shot) => Promise<Uint8Array>): void {
  Object.assign(window, { shoot: async (shot: Shot) => Array.from(await shoot(shot)).filter((_, i) => i % 4 < 3) });
}
