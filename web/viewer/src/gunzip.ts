/** Unpacks gzip to a size that is known before. */

/** Unpack exactly `size` bytes; stops as soon as there are more. `what` names the data in errors. */
export async function gunzip(bytes: Uint8Array<ArrayBuffer>, size: number, what: string): Promise<Uint8Array<ArrayBuffer>> {
  const reader = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")).getReader();
  const result = new Uint8Array(size);
  let filled = 0;
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    if (filled + part.value.length > size) {
      await reader.cancel();
      throw new Error(`${what}: more than the expected ${size} bytes`);
    }
    result.set(part.value, filled);
    filled += part.value.length;
  }
  if (filled !== size) throw new Error(`${what}: expected ${size} bytes, found ${filled}`);
  return result;
}
