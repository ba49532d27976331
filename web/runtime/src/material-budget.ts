/** What the programs of a scene's materials ask of a renderer, summed up before a driver refuses them with a log of its own. */

import { type Material, Mesh, type Object3D } from "three";
import { fail } from "./checks.ts";
import { BUDGET, overBudget } from "./graph/budget.ts";

/** What a renderer offers to a fragment shader; `renderer.capabilities` of a `WebGLRenderer` is one. */
export interface Capabilities {
  readonly maxTextures: number;
  readonly maxFragmentUniforms: number;
}

/** What a field asks of a fragment shader, for all lamps that it is evaluated for. */
export interface Demand {
  /** Characters of its text. */
  readonly text: number;
  /** Textures that it reads. */
  readonly textures: number;
  /** Uniform vectors. */
  readonly uniforms: number;
}

/** Uniform vectors of three's physical material without lights (r187: 29 matrices and vectors, rounded up), and of a lamp with its shadow. */
const MATERIAL_UNIFORMS = 48;
const LAMP_UNIFORMS = 12;
/** Textures that three.js adds to a standard material: the table of its specular lobe. */
const TABLES = 1;

/**
 * Throws a `FormatError` when the program of a material has more text, textures or uniforms than it may.
 *
 * Args: the meshes; what each field asks for, of which every surface evaluates all; how many lamps cast shadows; what the
 * renderer offers, where known.
 */
export function checkMaterials(
  root: Object3D,
  fields: readonly Demand[],
  lamps: number,
  capabilities?: Capabilities,
): void {
  const sum = (name: keyof Demand) => fields.reduce((total, field) => total + field[name], 0);
  if (sum("text") > BUDGET.text) fail("fields", overBudget(BUDGET.text, "characters of shader text", "work"));
  if (!capabilities) return;
  const { maxTextures, maxFragmentUniforms } = capabilities;
  const uniforms = MATERIAL_UNIFORMS + LAMP_UNIFORMS * lamps + sum("uniforms");
  if (uniforms > maxFragmentUniforms)
    fail("fields", `at most ${maxFragmentUniforms} uniform vectors on this device, found ${uniforms}; use fewer lamps or fields`);
  const learned = sum("textures");
  root.traverse((object) => {
    if (!(object instanceof Mesh)) return;
    for (const material of [object.material].flat()) {
      const own = texturesOf(material);
      const total = own + TABLES + lamps + learned;
      if (total <= maxTextures) continue;
      fail(
        `material '${material.name}'`,
        `at most ${maxTextures} textures on this device, found ${total} (its own ${own}, of three.js ${TABLES}, shadow maps ${lamps}, learned light ${learned}); use fewer lamps or maps`,
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
