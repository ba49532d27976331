/** Hostile and broken libraries of spreadlets end in a message, never in a crash, a hang or wrong numbers. */

import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { readLibrary } from "lightwell/lens";
import { describe, expect, it } from "vitest";

const standard = (name: string) => new Uint8Array(readFileSync(fileURLToPath(new URL(`../../lightwell/lens/standard/${name}.lwsp`, import.meta.url))));
const DISC = standard("disc-32");

type Json = any;

function parts(file: Uint8Array): { header: Json; body: Uint8Array } {
  const length = new DataView(file.buffer, file.byteOffset).getUint32(8, true);
  return { header: JSON.parse(new TextDecoder().decode(file.subarray(12, 12 + length))), body: file.slice(12 + length) };
}

/** The standard library with something changed; its check sum is right again unless it is what was changed. */
function tampered(change: (header: Json, body: Uint8Array) => Uint8Array | void, rehash = true): Uint8Array {
  const { header, body } = parts(DISC);
  const made = change(header, body) ?? body;
  if (rehash) header.sha256 = createHash("sha256").update(made).digest("hex");
  let text = JSON.stringify(header);
  text += " ".repeat((4 - (new TextEncoder().encode(text).length % 4)) % 4);
  const encoded = new TextEncoder().encode(text);
  const file = new Uint8Array(12 + encoded.length + made.length);
  file.set(DISC.subarray(0, 8));
  new DataView(file.buffer).setUint32(8, encoded.length, true);
  file.set(encoded, 12);
  file.set(made, 12 + encoded.length);
  return file;
}

const cut = (from: number, to: number) => () => DISC.slice(from, to);

const CASES: [name: string, make: () => Uint8Array, message: RegExp][] = [
  ["an empty file", cut(0, 0), /bytes, found 0/],
  ["no library", () => new TextEncoder().encode("GLB or what else there may be"), /begins with LWSP/],
  ["a file that ends in its header", cut(0, 2000), /a whole header/],
  ["a file that ends in its points", cut(0, DISC.length - 400), /bytes of points/],
  ["more than the points", () => new Uint8Array([...DISC, 0, 0, 0, 0]), /bytes of points/],
  ["another version", () => Uint8Array.from(DISC, (b, i) => (i === 4 ? 9 : b)), /version: expected 1, found 9/],
  ["a header longer than the file", () => Uint8Array.from(DISC, (b, i) => (i === 11 ? 255 : b)), /a whole header/],
  ["a header that is no JSON", () => Uint8Array.from(DISC, (b, i) => (i === 12 ? 120 : b)), /a header in JSON/],
  ["points that were changed", () => tampered((_, body) => void (body[100]! ^= 1), false), /check sum/],
  ["another format", () => tampered((h) => void (h.format = "spreadlets")), /format/],
  ["an unknown family", () => tampered((h) => void (h.family = "magic")), /family: expected depth/],
  ["offsets of 12 bits", () => tampered((h) => void (h.offset_bits = 12)), /offset_bits/],
  ["two billion points", () => tampered((h) => void (h.points = 2_000_000_000)), /points: expected a number/],
  ["half a point", () => tampered((h) => void (h.points = 0.5)), /an integer/],
  ["two axes", () => tampered((h) => void h.axes.pop()), /three axes/],
  ["an axis that descends", () => tampered((h) => void h.axes[0].values.reverse()), /ascending/],
  ["an axis without end", () => tampered((h) => void (h.axes[0].values[185] = 1e999)), /a finite number/],
  ["axes of a million million nodes", () => tampered((h) => void (h.axes = [0, 1, 2].map(() => ({ name: "x", values: Array.from({ length: 5000 }, (_, i) => i) })))), /at most .* nodes/],
  ["columns of different lengths", () => tampered((h) => void h.records.count.pop()), /columns of one length/],
  ["a column that is missing", () => tampered((h) => void delete h.records.scale), /scale: expected an array/],
  ["a node outside the grid", () => tampered((h) => void (h.records.node[3] = 186)), /record 3: node/],
  ["a node below the grid", () => tampered((h) => void (h.records.node[3] = -1)), /record 3: node/],
  ["a node twice", () => tampered((h) => void (h.records.node[3] = h.records.node[2])), /one spreadlet for node/],
  ["a third tier", () => tampered((h) => void (h.records.tier[3] = 2)), /tier/],
  ["an unknown kind", () => tampered((h) => void (h.records.kind[3] = "dark")), /charge or primal/],
  ["points before the file", () => tampered((h) => void (h.records.first[3] = -4)), /first/],
  ["points behind the file", () => tampered((h) => void (h.records.count[3] = 1 << 20)), /count/],
  ["no points", () => tampered((h) => void (h.records.count[3] = 0)), /count/],
  ["a scale of 0", () => tampered((h) => void (h.records.scale[3] = 0)), /scale/],
  ["a scale below what a float holds", () => tampered((h) => void (h.records.scale[3] = 1e-60)), /above 0/],
  ["a scale without end", () => tampered((h) => void (h.records.scale[3] = 1e999)), /scale/],
  ["a node that was not baked", () => tampered((h) => void (Object.values(h.records) as unknown[][]).forEach((column) => column.splice(7, 1))), /node 7: expected a spreadlet/],
  [
    "charges that do not sum to zero",
    () =>
      tampered((h, body) => {
        const charge = h.records.kind.indexOf("charge");
        body[4 * h.records.first[charge] + 2]! ^= 1;
      }),
    /charges that sum to 0/,
  ],
];

describe("readLibrary", () => {
  it("reads the standard libraries", async () => {
    const disc = await readLibrary(DISC);
    expect([disc.family, disc.main.length]).toEqual(["depth", 186]);
    expect(disc.fine.filter(Boolean).length).toBeGreaterThan(20);
    expect(Math.abs(disc.reach.at(-1)! - 33)).toBeLessThan(2);
    expect(disc.axes[0].at(-1)).toBe(32);
    const joint = await readLibrary(standard("disc-16-speed-32"));
    expect([joint.family, joint.main.length]).toEqual(["depth-speed", joint.axes[0].length * joint.axes[1].length]);
  });

  it.each(CASES)("refuses %s", async (_, make, message) => {
    await expect(readLibrary(make())).rejects.toThrow(message);
  });

  it("survives any flipped byte of the header", async () => {
    let seed = 7;
    for (let i = 0; i < 300; i++) {
      seed = (seed * 1103515245 + 12345) & 0x7fffffff;
      const file = DISC.slice();
      file[seed % 25_000]! ^= 1 << (i % 8);
      // A flipped digit of an error or a scale may still be a library; whatever is read is whole.
      await readLibrary(file).then(
        (found) => expect(found.main.every((one) => one.count > 0 && one.first + one.count <= found.points.length)).toBe(true),
        (error) => expect(String(error)).toMatch(/^(FormatError|RangeError)/),
      );
    }
  }, 30_000);
});
