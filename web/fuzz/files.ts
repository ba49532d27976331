/** Files of a JSON head and a binary body: taken apart, and put together again with lengths that are right. */

import { createHash } from "node:crypto";

/** A format that is fuzzed. */
export type Format = "glb" | "lwp" | "lwsp";

/** A file in two parts. */
export interface Parts {
  readonly text: string;
  readonly body: Uint8Array;
}

/** Where a format has its head: bytes before the JSON, and the place of the JSON's length. */
const HEADS: Readonly<Record<Format, readonly [before: number, length: number]>> = { glb: [20, 12], lwp: [12, 8], lwsp: [12, 8] };
/** Bytes between the JSON and the body. */
const between = (format: Format) => (format === "glb" ? 8 : 0);

const view = (bytes: Uint8Array) => new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);

/** Take a file apart. */
export function partsOf(format: Format, file: Uint8Array): Parts {
  const [before, at] = HEADS[format];
  const end = before + view(file).getUint32(at, true);
  return { text: new TextDecoder().decode(file.subarray(before, end)), body: file.slice(end + between(format)) };
}

/** Put a file together; the check sum of a library is that of its body again. */
export function fileOf(format: Format, seed: Uint8Array, { text, body }: Parts): Uint8Array {
  const [before, at] = HEADS[format];
  const signed = format === "lwsp" ? text.replace(/("sha256":\s*")[0-9a-f]*/, `$1${createHash("sha256").update(body).digest("hex")}`) : text;
  const encoded = new TextEncoder().encode(signed);
  const size = Math.ceil(encoded.length / 4) * 4;
  const file = new Uint8Array(before + size + between(format) + body.length);
  file.fill(0x20, before, before + size);
  file.set(seed.subarray(0, before));
  file.set(encoded, before);
  file.set(body, before + size + between(format));
  const words = view(file);
  words.setUint32(at, size, true);
  if (format === "glb") {
    words.setUint32(8, file.length, true);
    words.setUint32(before + size, body.length, true);
    words.setUint32(before + size + 4, 0x004e4942, true);
  }
  return file;
}
