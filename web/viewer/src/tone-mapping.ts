/** Tone curves of the output pass. */

export const TONE_MAPPINGS = ["agx", "aces", "neutral", "none"] as const;

export type ToneMappingName = (typeof TONE_MAPPINGS)[number];

/** Label, and the name of three.js' GLSL function; `none` clips. */
export const TONE_MAPPING_TEXTS: Record<ToneMappingName, { label: string; glsl: string }> = {
  agx: { label: "AgX", glsl: "AgXToneMapping" },
  aces: { label: "ACES", glsl: "ACESFilmicToneMapping" },
  neutral: { label: "Neutral", glsl: "NeutralToneMapping" },
  none: { label: "None", glsl: "LinearToneMapping" },
};
