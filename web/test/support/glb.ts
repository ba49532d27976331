/** Writes small GLB files for the tests: boxes and quads with the lightwell extension. */

/** A closed-form or learned field of a fixture. */
export interface FixtureField {
  name?: string;
  role: "indirect" | "static";
  variable?: number;
  graph: Record<string, unknown> & { buffers?: Record<string, FixtureBuffer> };
}

export interface FixtureBuffer {
  shape: number[];
  type: "float32" | "float16" | "int8" | "uint8";
  values: ArrayLike<number>;
  scale?: number | number[];
  offset?: number;
}

/** Triangles of one material. */
export interface FixtureMesh {
  positions: number[];
  normals: number[];
  indices: number[];
  material: number;
  uv?: number[];
}

export interface Fixture {
  meshes: FixtureMesh[];
  materials: Record<string, unknown>[];
  variables: Record<string, unknown>[];
  fields: FixtureField[];
  /** The light of what is added; files with it are of version 2. */
  probes?: FixtureField[];
  /** Accessors of vectors, behind all others. */
  numbers?: readonly { readonly values: readonly number[]; readonly type: "SCALAR" | "VEC3" }[];
  /** Last word on the document, for hostile files. */
  tamper?: (json: Record<string, never> & { [key: string]: unknown }) => void;
}

const COMPONENT = { float32: 5126, float16: 5123, int8: 5120, uint8: 5121 };
const ARRAY = { float32: Float32Array, float16: Uint16Array, int8: Int8Array, uint8: Uint8Array };

/** The bytes of a GLB. */
export function writeGlb(fixture: Fixture): Uint8Array<ArrayBuffer> {
  const chunks: Uint8Array[] = [];
  const bufferViews: unknown[] = [];
  const accessors: Record<string, unknown>[] = [];
  let length = 0;
  const add = (data: ArrayBufferView, componentType: number, type: string, count: number, extra = {}) => {
    const bytes = new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
    bufferViews.push({ buffer: 0, byteOffset: length, byteLength: bytes.length });
    accessors.push({ bufferView: bufferViews.length - 1, componentType, type, count, ...extra });
    const padded = new Uint8Array(Math.ceil(bytes.length / 4) * 4);
    padded.set(bytes);
    chunks.push(padded);
    length += padded.length;
    return accessors.length - 1;
  };
  const meshes = fixture.meshes.map((mesh) => {
    const count = mesh.positions.length / 3;
    const along = (axis: number) => mesh.positions.filter((_, i) => i % 3 === axis);
    const range = {
      min: [0, 1, 2].map((k) => Math.min(...along(k))),
      max: [0, 1, 2].map((k) => Math.max(...along(k))),
    };
    const attributes = {
      POSITION: add(new Float32Array(mesh.positions), 5126, "VEC3", count, range),
      NORMAL: add(new Float32Array(mesh.normals), 5126, "VEC3", count),
      ...(mesh.uv ? { TEXCOORD_0: add(new Float32Array(mesh.uv), 5126, "VEC2", count) } : {}),
    };
    const indices = add(new Uint16Array(mesh.indices), 5123, "SCALAR", mesh.indices.length);
    return { primitives: [{ attributes, indices, material: mesh.material }] };
  });
  const stored = (field: FixtureField) => {
    const buffers = Object.entries(field.graph.buffers ?? {}).map(([id, { values, ...buffer }]) => {
      const accessor = add(ARRAY[buffer.type].from(values), COMPONENT[buffer.type], "SCALAR", values.length);
      return [id, { ...buffer, accessor }];
    });
    return { ...field, graph: { ...field.graph, buffers: Object.fromEntries(buffers) } };
  };
  const fields = fixture.fields.map(stored);
  const probes = fixture.probes ? { version: 2, probes: fixture.probes.map(stored) } : {};
  for (const { values, type } of fixture.numbers ?? []) add(new Float32Array(values), 5126, type, values.length / (type === "VEC3" ? 3 : 1));
  const json = {
    asset: { version: "2.0", generator: "lightwell tests" },
    scene: 0,
    scenes: [{ nodes: meshes.map((_, i) => i) }],
    nodes: meshes.map((_, i) => ({ mesh: i })),
    meshes,
    materials: fixture.materials,
    accessors,
    bufferViews,
    buffers: [{ byteLength: length }],
    // Those that are there alone: what passes a file on drops the names of others.
    extensionsUsed: [...new Set(["LIGHTWELL_neural_radiance", ...fixture.materials.flatMap(({ extensions }) => Object.keys(extensions ?? {}))])],
    extensions: { LIGHTWELL_neural_radiance: { version: 1, variables: fixture.variables, fields, ...probes } },
  };
  const document = structuredClone(json);
  fixture.tamper?.(document as never);
  return pack(document, chunks);
}

function pack(json: unknown, chunks: Uint8Array[]): Uint8Array<ArrayBuffer> {
  const text = new TextEncoder().encode(JSON.stringify(json));
  const head = new Uint8Array(Math.ceil(text.length / 4) * 4).fill(0x20);
  head.set(text);
  const body = chunks.reduce((sum, chunk) => sum + chunk.length, 0);
  const bytes = new Uint8Array(28 + head.length + body);
  const view = new DataView(bytes.buffer);
  [0x46546c67, 2, bytes.length, head.length, 0x4e4f534a].forEach((word, i) => {
    view.setUint32(4 * i, word, true);
  });
  bytes.set(head, 20);
  view.setUint32(20 + head.length, body, true);
  view.setUint32(24 + head.length, 0x004e4942, true);
  let at = 28 + head.length;
  for (const chunk of chunks) {
    bytes.set(chunk, at);
    at += chunk.length;
  }
  return bytes;
}

type Point = [number, number, number];

/** A quad: corner, two edges; its normal is their cross product. */
export function quad(material: number, corner: Point, a: Point, b: Point): FixtureMesh {
  const sum = (...points: Point[]) => [0, 1, 2].map((k) => points.reduce((s, p) => s + p[k]!, 0));
  const n = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const length = Math.hypot(...n);
  const normal = n.map((x) => x / length);
  return {
    positions: [...corner, ...sum(corner, a), ...sum(corner, a, b), ...sum(corner, b)],
    normals: [...normal, ...normal, ...normal, ...normal],
    indices: [0, 1, 2, 0, 2, 3],
    material,
  };
}

/** A box standing on y = low, turned about the vertical axis. */
export function box(material: number, center: Point, size: Point, turn = 0): FixtureMesh[] {
  const [c, s] = [Math.cos(turn), Math.sin(turn)];
  const axis = (x: number, y: number, z: number): Point => [c * x + s * z, y, -s * x + c * z];
  const at = (x: number, y: number, z: number): Point => {
    const p = axis((x * size[0]) / 2, (y * size[1]) / 2, (z * size[2]) / 2);
    return [center[0] + p[0], center[1] + p[1], center[2] + p[2]];
  };
  const [x, y, z] = [axis(size[0], 0, 0), axis(0, size[1], 0), axis(0, 0, size[2])];
  const minus = (p: Point): Point => [-p[0], -p[1], -p[2]];
  return [
    quad(material, at(-1, -1, 1), x, y),
    quad(material, at(1, -1, -1), minus(x), y),
    quad(material, at(1, -1, 1), minus(z), y),
    quad(material, at(-1, -1, -1), z, y),
    quad(material, at(-1, 1, 1), x, minus(z)),
    quad(material, at(-1, -1, -1), x, z),
  ];
}

/** A smooth ball. */
export function ball(material: number, center: Point, radius: number, rings = 24): FixtureMesh {
  const mesh: FixtureMesh = { positions: [], normals: [], indices: [], material };
  const columns = 2 * rings;
  for (let i = 0; i <= rings; i++) {
    for (let k = 0; k <= columns; k++) {
      const [theta, phi] = [(Math.PI * i) / rings, (2 * Math.PI * k) / columns];
      const n = [Math.sin(theta) * Math.sin(phi), Math.cos(theta), Math.sin(theta) * Math.cos(phi)];
      mesh.normals.push(...n);
      mesh.positions.push(...n.map((x, axis) => center[axis]! + radius * x));
      if (i === rings || k === columns) continue;
      const a = i * (columns + 1) + k;
      const b = a + columns + 1;
      mesh.indices.push(a, b, b + 1, a, b + 1, a + 1);
    }
  }
  return mesh;
}

/** A Lambertian material: the glTF coat is switched off. */
export function matte(r: number, g: number, b: number): Record<string, unknown> {
  return {
    pbrMetallicRoughness: { baseColorFactor: [r, g, b, 1], metallicFactor: 0, roughnessFactor: 1 },
    extensions: { KHR_materials_specular: { specularFactor: 0 } },
  };
}
