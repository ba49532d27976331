/** Pictures read back from the GPU, first row at the top. */

import { DataUtils, type WebGLRenderer, type WebGLRenderTarget } from "three";

/** RGBA pixels. */
export interface Picture<Data> {
  readonly width: number;
  readonly height: number;
  readonly data: Data;
}

/** Mean luminance of a well-exposed picture, and the factors that exposure stays within. */
const MIDDLE_GREY = 0.2;
const MAX_EXPOSURE = 1e4;

/** The canvas, 8 bits; call in the task that drew it. */
export function readCanvas(renderer: WebGLRenderer): Picture<Uint8Array> {
  const gl = renderer.getContext() as WebGL2RenderingContext;
  const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const rows = new Uint8Array(width * height * 4);
  renderer.setRenderTarget(null);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rows);
  return { width, height, data: flipRows(rows, width * 4) };
}

/** A canvas of any kind, 8 bits; call in the task that drew it. */
export function readShown(canvas: HTMLCanvasElement): Picture<Uint8Array> {
  const { width, height } = canvas;
  const context = new OffscreenCanvas(width, height).getContext("2d")!;
  context.drawImage(canvas, 0, 0);
  return { width, height, data: new Uint8Array(context.getImageData(0, 0, width, height).data) };
}

/** A half-float target as linear radiance; alpha is coverage. */
export function readTarget(renderer: WebGLRenderer, target: WebGLRenderTarget): Picture<Float32Array> {
  const { width, height } = target;
  const rows = new Uint16Array(width * height * 4);
  renderer.readRenderTargetPixels(target, 0, 0, width, height, rows);
  return { width, height, data: Float32Array.from(flipRows(rows, width * 4), DataUtils.fromHalfFloat) };
}

/** Median milliseconds over some frames that `draw` draws and that are waited for. */
export function timeFrames(renderer: WebGLRenderer, frames: number, draw: () => void): number {
  const gl = renderer.getContext() as WebGL2RenderingContext;
  const pixel = new Uint8Array(4);
  const times = Array.from({ length: frames }, () => {
    const start = performance.now();
    draw();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    return performance.now() - start;
  });
  return times.sort((a, b) => a - b)[frames >> 1]!;
}

/** Exposure that puts the geometric mean of the covered pixels at middle grey. */
export function meterExposure({ data }: Picture<Float32Array>): number {
  let sum = 0;
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    if (data[i + 3]! < 0.5) continue;
    const luminance = 0.2126 * data[i]! + 0.7152 * data[i + 1]! + 0.0722 * data[i + 2]!;
    sum += Math.log(Math.max(luminance, 1e-6));
    count++;
  }
  if (count === 0) return 1;
  return Math.min(MAX_EXPOSURE, Math.max(1 / MAX_EXPOSURE, MIDDLE_GREY / Math.exp(sum / count)));
}

function flipRows<T extends Uint8Array | Uint16Array>(rows: T, stride: number): T {
  const flipped = rows.slice() as T;
  const height = rows.length / stride;
  for (let y = 0; y < height; y++) {
    flipped.set(rows.subarray((height - 1 - y) * stride, (height - y) * stride), y * stride);
  }
  return flipped;
}
