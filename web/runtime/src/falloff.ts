/** How near to a lamp its light still grows, in all engines. */

/** Least square of the distance to a lamp, GLSL: a millimetre. At three.js' own 0.1 m, scenes of some centimetres would have no falloff at all. */
export const MIN_REACH = "1e-6";
