/** How many lights a scene may have; apart from what reads them, which is loaded with a file. */

/** Largest number of declared lights: each one costs a shadow map and an evaluation of its field. */
export const MAX_VARIABLES = 4;

/** Largest number of lamps in a scene: those of the declared lights, and more of the same kind. */
export const MAX_LAMPS = 4;
