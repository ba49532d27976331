/** What the programs of a scene's materials ask of a renderer, summed up before a driver refuses them with a log of its own. */

import { type Material, Mesh, type Object3D } from "three";
import { fail } from "./checks.ts";
import type { FieldProgram } from "./field-program.ts";
import { BUDGET, overBudget } from "./graph/index.ts";

/** What a renderer offers to a fragment shader: `renderer.capabilities` of three.js. */
export interface Capabilities {
  readonly maxTextures: number;
  readonly maxFragmentUniforms: number;
}

/** Uniform vectors of three's physical material without lights (r187: 29 matrices and vectors, rounded up), and of a lamp with its shadow. */
const MATERIAL_UNIFORMS = 48;
const LAMP_UNIFORMS = 12;

/**
 * Throws a `FormatError` when the program of a material has more text, textures or uniforms than it may.
 *
 * Args: the meshes; the fields that every surface evaluates; how many lamps cast shadows; what the renderer offers, where known.
 */
export function checkMaterials(
  root: Object3D,
  fields: readonly FieldProgram[],
  lamps: number,
  capabilities?: Capabilities,
): void {
  const sum = (of: (field: FieldProgram) => number) => fields.reduce((total, field) => total + of(field), 0);
  const text = sum((field) => field.code.length);
  if (text > BUDGET.text) fail("fields", overBudget(BUDGET.text, "characters of shader text", "work"));
  if (!capabilities) return;
  const uniforms = MATERIAL_UNIFORMS + LAMP_UNIFORMS * lamps + sum((field) => field.uniformVectors);
  if (uniforms > capabilities.maxFragmentUniforms)
    fail("fields", `at most ${capabilities.maxFragmentUniforms} uniform vectors on this device, found ${uniforms}; use fewer lamps or fields`);
  const learned = sum((field) => field.samplers);
  root.traverse((object) => {
    if (!(object instanceof Mesh)) return;
    for (const material of [object.material].flat()) {
      const own = texturesOf(material);
      const total = own + lamps + learned;
      if (total <= capabilities.maxTextures) continue;
      fail(
        `material '${material.name}'`,
        `at most ${capabilities.maxTextures} textures on this device, found ${total} (its own ${own}, shadow maps ${lamps}, learned light ${learned}); use fewer lamps or maps`,
      );
    }
  });
}

/** Textures that a material reads in fragments. */
function texturesOf(material: Material): number {
  const maps = Object.entries(material).filter(
    ([name, value]) => name !== "displacementMap" && (value as { isTexture?: boolean } | null)?.isTexture,
  );
  const transmits = ((material as { transmission?: number }).transmission ?? 0) > 0;
  return new Set(maps.map(([, value]) => value)).size + (transmits ? 1 : 0);
}
