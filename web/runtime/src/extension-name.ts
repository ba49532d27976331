/** Name of the glTF extension that carries learned light. */
export const EXTENSION = "LIGHTWELL_neural_radiance";
