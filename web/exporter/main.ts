/**
 * The exporter of the command line: one function from JSON to JSON, which `lightwell export` runs. Built into
 * `lightwell/graph/exporter.js`, so that there is one printer for the web and for the command line.
 *
 * Request: { graph, arrays: { buffer: base64 }, pictures: { buffer: mips }, options, work }. Answer: { text, tables: [{ …, data: base64 }],
 * pictures: { uniform: buffer } } or { error }. It must run in a bare JavaScript engine: no DOM, no Node.
 */

import { budgetOf, readGraph, type StoredBuffer } from "../runtime/src/graph/index.ts";
import { type ExportOptions, exportShader } from "../runtime/src/export.ts";

const ARRAYS = { float32: Float32Array, float16: Uint16Array, int8: Int8Array, uint8: Uint8Array } as const;
const DIGITS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

interface Request {
  readonly graph: { readonly buffers?: Record<string, Omit<StoredBuffer, "data">> };
  readonly arrays: Record<string, string>;
  readonly pictures: Record<string, number>;
  readonly options: ExportOptions;
  /** Work per pixel that the graph may ask for; that of the default budget unless given. */
  readonly work?: number;
}

function decode(text: string): ArrayBuffer {
  const bytes = new Uint8Array(Math.floor((3 * text.replace(/=+$/, "").length) / 4));
  let [at, bits, value] = [0, 0, 0];
  for (let i = 0; i < text.length && at < bytes.length; i++) {
    value = (value << 6) | DIGITS.indexOf(text[i]!);
    bits += 6;
    if (bits < 8) continue;
    bits -= 8;
    bytes[at++] = (value >> bits) & 255;
  }
  return bytes.buffer;
}

function encode(data: ArrayBufferView): string {
  const bytes = new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
  const parts: string[] = [];
  for (let i = 0; i < bytes.length; i += 3) {
    const left = bytes.length - i;
    const word = (bytes[i]! << 16) | ((bytes[i + 1] ?? 0) << 8) | (bytes[i + 2] ?? 0);
    const digits = [18, 12, 6, 0].map((shift) => DIGITS[(word >> shift) & 63]!);
    parts.push(digits.map((digit, k) => (k <= left ? digit : "=")).join(""));
  }
  return parts.join("");
}

function answer({ graph: document, arrays, pictures, options, work }: Request): unknown {
  const names = new Map<StoredBuffer, string>();
  const buffers = new Map<string, StoredBuffer>();
  for (const [name, form] of Object.entries(document.buffers ?? {})) {
    const mips = pictures[name];
    const buffer: StoredBuffer =
      mips === undefined
        ? { ...form, data: new ARRAYS[form.type](decode(arrays[name]!)) }
        : { ...form, data: new Uint8Array(0), picture: { source: name, mips, bytes: 0 } };
    names.set(buffer, name);
    buffers.set(name, buffer);
  }
  const shader = exportShader(readGraph(document, buffers, budgetOf(work === undefined ? {} : { work })), options);
  return {
    text: shader.text,
    tables: shader.tables.map((table) => ({ ...table, data: encode(table.data) })),
    pictures: Object.fromEntries([...shader.pictures].map(([uniform, buffer]) => [uniform, names.get(buffer)!])),
  };
}

(globalThis as unknown as { lightwellExport: (request: string) => string }).lightwellExport = (request) => {
  try {
    return JSON.stringify(answer(JSON.parse(request) as Request));
  } catch (error) {
    return JSON.stringify({ error: error instanceof Error ? error.message : String(error) });
  }
};
