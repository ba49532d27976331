/** A camera for all engines that draw an exported light map, and how a page offers its picture. */

export interface Frame {
  /** Base64 of the file. */
  readonly glb: string;
  /** Address of the exported folder, with a slash at its end. */
  readonly folder: string;
  readonly size: readonly [number, number];
  readonly position: readonly [number, number, number];
  readonly target: readonly [number, number, number];
  /** Vertical field of view, degrees. */
  readonly fov: number;
  readonly near: number;
  readonly far: number;
}

export const bytesOf = ({ glb }: Frame): ArrayBuffer => Uint8Array.from(atob(glb), (c) => c.charCodeAt(0)).buffer;

/** Bytes RGBA of what a context shows, last row first. */
export function read(gl: WebGL2RenderingContext, [width, height]: Frame["size"]): Uint8Array {
  const rows = new Uint8Array(4 * width * height);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rows);
  return rows;
}

/** Offer `shoot(frame)`, which gives bytes RGB. */
export function publish(draw: (frame: Frame) => Promise<Uint8Array>): void {
  Object.assign(window, { shoot: async (frame: Frame) => Array.from(await draw(frame)).filter((_, i) => i % 4 < 3) });
}
