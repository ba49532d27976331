/** Stored numbers of a graph, and the limits that they and everything else are held to. */

/** Limits that no honest field comes near, as in the Python package. */
export const MAX_WIDTH = 4096;
export const MAX_NODES = 4096;
export const MAX_ELEMENTS = 1 << 26;
export const MAX_MACS = 1 << 24;
/** Largest count that a 32-bit float holds exactly, as do all whole numbers below it. */
export const MAX_EXACT = 1 << 24;
export const MAX_NUMBER = 3.4028234663852886e38;

export type BufferType = "float32" | "float16" | "int8" | "uint8";

/** A buffer that is a picture: bytes of red, green and blue, which shaders sample where they are. */
export interface BufferPicture {
  /** What the sampler uniform is set to; the graph only hands it on. */
  readonly source: unknown;
  /** Mip level up to which the picture may be minified. */
  readonly mips: number;
  /** Size of the encoded picture; 0 when unknown. */
  readonly bytes: number;
}

/** One buffer as it is stored; `float16` keeps its bits. */
export interface StoredBuffer {
  readonly shape: readonly number[];
  readonly type: BufferType;
  readonly scale?: number | readonly number[];
  readonly offset?: number;
  /** Empty when the numbers are those of a picture. */
  readonly data: Float32Array | Uint16Array | Int8Array | Uint8Array;
  readonly picture?: BufferPicture;
}
