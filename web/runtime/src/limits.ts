/** What a file may ask for before anything of it is decoded; the numbers of `lightwell/limits.py` where a page can hold them. */

export const LIMITS = {
  /** Entries of one table of the document, and of children of a node. */
  entries: 1 << 20,
  /** Elements of one accessor. */
  elements: 1 << 28,
  /** Bytes that all accessors stand for. */
  bytes: 1 << 30,
  /** Bytes of accessors that have no bytes in the file, as sparse ones may: they are all zeros before. */
  zeros: 1 << 26,
  /** Vertices and vertex indices that are drawn, those of instances included. */
  vertices: 32_000_000,
  indices: 96_000_000,
  /** Bytes that morph targets take on the GPU. */
  morphs: 1 << 28,
  nodes: 500_000,
  /** Levels of the node tree: three.js walks it by recursion. */
  depth: 4_000,
  /** Texels along the longer edge of one picture, of one picture, and of all together (four bytes each on the GPU). */
  pictureEdge: 16_384,
  pictureTexels: 16_384 * 8_192,
  texels: 600_000_000,
} as const;
