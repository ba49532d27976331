/** A surface like any other, at which a field is tried before it is drawn. */

/** The inputs of a field, by name. */
export const TRIAL: Readonly<Record<string, readonly number[]>> = {
  position: [0, 0, 0],
  normal: [0, 1, 0],
  view: [0, 0.8, 0.6],
  light: [0, 1, 0],
  reflectance: [0.5, 0.5, 0.5],
  roughness: [0.5],
  metallic: [0],
  shading_normal: [0, 1, 0],
  rest_position: [0, 0, 0],
  rest_normal: [0, 1, 0],
  uv: [0.5, 0.5],
  uv1: [0.5, 0.5],
};
