/** Parts of the shaders of three.js that ours go into. */

/** Put text in the place of a part of a shader; throws when three.js, or whoever patched before, has it no more. */
export function replacePart(shader: string, part: string, text: string): string {
  if (!shader.includes(part))
    throw new Error(`lightwell: expected '${part}' in a shader of three.js, found none; use a version that is supported, or keep it`);
  return shader.replace(part, () => text);
}
