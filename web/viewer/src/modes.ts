/** What the page shows. */

export const MODES = ["learned", "reference", "difference", "direct", "indirect", "split", "experts", "lightmap"] as const;

export type Mode = (typeof MODES)[number];

/** Name, key and explanation of each mode, in the order of the control. */
export const MODE_TEXTS: Record<Mode, { label: string; key: string; hint: string }> = {
  learned: { label: "Learned", key: "1", hint: "Direct light plus the learned light" },
  reference: { label: "Reference", key: "2", hint: "The path-traced picture of a saved view" },
  difference: { label: "Difference", key: "3", hint: "Relative error of the learned picture" },
  direct: { label: "Direct", key: "4", hint: "Direct light and emission alone" },
  indirect: { label: "Indirect", key: "5", hint: "The learned light alone" },
  split: { label: "Split", key: "6", hint: "Direct light, reference or light map to the left, learned to the right" },
  experts: { label: "Experts", key: "7", hint: "Which part of the learned light shades each point" },
  lightmap: { label: "Light map", key: "8", hint: "An ordinary light map in place of the learned light" },
};

/** What a file has beside its learned light. */
export interface Material {
  readonly hasExperts: boolean;
  readonly hasLightmaps: boolean;
  /** Path-traced pictures of saved views. */
  readonly hasReferences: boolean;
}

/** Whether a mode has anything to show. */
export function canShow(mode: Mode, { hasExperts, hasLightmaps, hasReferences }: Material): boolean {
  if (mode === "experts") return hasExperts;
  if (mode === "lightmap") return hasLightmaps;
  return hasReferences || (mode !== "reference" && mode !== "difference");
}

/** Why it has not. */
export function whyNot(mode: Mode): string {
  if (mode === "experts") return "The learned light of this file has no parts to tell apart.";
  if (mode === "lightmap") return "This file carries no ordinary light map.";
  return "This file carries no path-traced pictures to compare with.";
}

/** What the learned picture is held against in split mode. */
export const AGAINST = ["direct", "reference", "lightmap"] as const;

export type Against = (typeof AGAINST)[number];
