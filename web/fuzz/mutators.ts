/** One way to damage a file for each kind of damage; the same on every machine for the same seed. */

import { bomb } from "./bombs.ts";
import { type Format, fileOf, partsOf } from "./files.ts";
import type { Random } from "./random.ts";

/** Damages a file of a format. */
type Mutator = (format: Format, seed: Uint8Array, random: Random) => Uint8Array;

type Json = any;
/** A member of an object or an entry of an array. */
interface Place {
  readonly parent: Json;
  readonly key: string | number;
}

const EDGES = [0, -1, 1, 2, 3, 4, 255, 256, 65_535, 65_536, 2 ** 24 + 1, 2 ** 31 - 1, 2 ** 31, 2 ** 32 - 1, 2 ** 32, 2 ** 53, 0.5, 1e300];
/** JSON reads the last of these as infinity. */
const NUMBERS = ["1e39", "-1e39", "3.4e38", "1e-46", "-0.0", "1e308", "1e29", "-1", "0.5", "4096", "1e999", "-1e999"];
const COUNTS = /^(count|byteLength|byteOffset|byteStride|width|start|rows|octaves|bins|degree|depth|levels|entries_log2|mips|version|variable|accessor|bufferView|buffer|texture|componentType|mode|points|offset_bits|\d+)$/;
const URIS = [
  "file:///etc/passwd",
  "http://127.0.0.1:9/x",
  "//[::1]/x",
  "../../../../etc/passwd",
  "data:,",
  "data:application/octet-stream;base64,AAAA",
  "data:image/png;base64,iVBORw0KGgo=",
  "data:image/png;base64,%%%",
  "javascript:alert(1)",
  "\u0000",
  "",
  "%",
  "x".repeat(100_000),
];
const VALUES: readonly Json[] = [null, true, false, "", "x", 0, -1, 1.5, [], {}, [1], [[]], { a: 1 }, ["POSITION"], "__proto__", { length: 3 }];

const view = (bytes: Uint8Array) => new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);

/** All places of a document. */
function placesOf(json: Json): Place[] {
  const out: Place[] = [];
  const visit = (parent: Json) => {
    for (const key of Array.isArray(parent) ? parent.keys() : Object.keys(parent)) {
      out.push({ parent, key });
      if (parent[key] && typeof parent[key] === "object") visit(parent[key]);
    }
  };
  visit(json);
  return out;
}

/** A place among those that fit; in half of the cases one of the extension's, where there is one. */
function choose(json: Json, random: Random, fits: (place: Place) => boolean = () => true): Place | null {
  const own = json.extensions?.LIGHTWELL_neural_radiance;
  const within = own && random.real() < 0.5 ? placesOf(own) : placesOf(json);
  const fitting = within.filter(fits);
  return fitting.length ? random.of(fitting) : null;
}

/** A mutator that changes the JSON; what `change` returns replaces the words `@@…@@` of strings by bare text. */
function ofJson(change: (json: Json, random: Random) => void): Mutator {
  return (format, seed, random) => {
    const { text, body } = partsOf(format, seed);
    const json = JSON.parse(text);
    change(json, random);
    const written = JSON.stringify(json).replace(/"@@(.*?)@@"/g, (_, bare: string) => bare.replaceAll("'", '"'));
    return fileOf(format, seed, { text: written, body });
  };
}

const bits: Mutator = (_format, seed, random) => {
  const file = seed.slice();
  for (let n = 1 + random.below(16); n > 0; n--) file[random.below(file.length)]! ^= 1 << random.below(8);
  return file;
};

const truncation: Mutator = (_format, seed, random) => seed.slice(0, random.below(seed.length));

/** Lengths in the head of the file, and those that its JSON states. */
const lengths: Mutator = (format, seed, random) => {
  if (random.real() < 0.5) return counts(format, seed, random);
  const file = seed.slice();
  const at = 4 * random.below(6);
  view(file).setUint32(at, (random.real() < 0.5 ? view(file).getUint32(at, true) + random.below(33) - 16 : random.of(EDGES)) >>> 0, true);
  return file;
};

const counts: Mutator = ofJson((json, random) => {
  for (let n = 1 + random.below(2); n > 0; n--) {
    const place = choose(json, random, ({ parent, key }) => typeof parent[key] === "number" && COUNTS.test(String(key)));
    if (!place) return;
    const { parent, key } = place;
    parent[key] = random.real() < 0.5 ? parent[key] + random.of([-1, 1, 2, -2, 16]) : random.of(EDGES);
  }
});

/** Numbers that are none, or overflow: in the JSON, or in the body as 32-bit or 16-bit floats. */
const numbers: Mutator = (format, seed, random) => {
  if (random.real() < 0.5) {
    return ofJson((json) => {
      const place = choose(json, random, ({ parent, key }) => typeof parent[key] === "number");
      if (place) place.parent[place.key] = `@@${random.of(NUMBERS)}@@`;
    })(format, seed, random);
  }
  const { text, body } = partsOf(format, seed);
  for (let n = 1 + random.below(8); n > 0 && body.length >= 4; n--) {
    const at = 4 * random.below(body.length >> 2);
    view(body).setUint32(at, random.of([0x7f800000, 0xff800000, 0x7fc00000, 0x7c007c00, 0xfe00fe00, 0x7f7fffff, 0x00000001]), true);
  }
  return fileOf(format, seed, { text, body });
};

const types: Mutator = ofJson((json, random) => {
  const place = choose(json, random);
  if (place) place.parent[place.key] = structuredClone(random.of(VALUES));
});

/** An entry twice, a member twice, one thing in the place of another. */
const duplicates: Mutator = ofJson((json, random) => {
  const array = choose(json, random, ({ parent, key }) => Array.isArray(parent[key]) && parent[key].length > 0);
  const [from, to] = [choose(json, random), choose(json, random)];
  if (random.real() < 0.4 && array) {
    const entries = array.parent[array.key];
    const copies = random.of([1, 1, 2, 300, 5000]);
    for (let n = 0; n < copies; n++) entries.push(structuredClone(random.of(entries)));
  } else if (from && to) to.parent[to.key] = structuredClone(from.parent[from.key]);
});

const nesting: Mutator = ofJson((json, random) => {
  const place = choose(json, random);
  const depth = random.of([1, 2, 10, 100, 5000, 20_000]);
  const [open, close] = random.of([["[", "]"], ["{'a':", "}"], ["{'children':[", "]}"]] as const);
  if (place) place.parent[place.key] = `@@${open.repeat(depth)}0${close.repeat(depth)}@@`;
});

const uris: Mutator = ofJson((json, random) => {
  const uri = random.of(URIS);
  const image = { uri, mimeType: random.of(["image/png", "image/ktx2", "text/html", ""]) };
  const put = (table: string, entry: Json) => {
    if (Array.isArray(json[table]) && json[table].length && random.real() < 0.5) random.of<Json>(json[table]).uri = uri;
    else json[table] = [...(Array.isArray(json[table]) ? json[table] : []), entry];
  };
  if (random.real() < 0.5) put("buffers", { byteLength: random.of([1, 4, 64]), uri });
  else {
    put("images", image);
    json.textures = [...(json.textures ?? []), { source: json.images.length - 1 }];
    const material: Json = json.materials?.[0];
    if (material) material.emissiveTexture = { index: json.textures.length - 1 };
  }
});

/** All kinds of damage. */
export const MUTATORS = {
  bits,
  truncation,
  lengths,
  counts,
  numbers,
  types,
  duplicates,
  nesting,
  uris,
  bombs: (format, seed, random) => (format === "glb" ? ofJson(bomb)(format, seed, random) : counts(format, seed, random)),
} as const satisfies Record<string, Mutator>;

export type Kind = keyof typeof MUTATORS;
