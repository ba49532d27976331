/** A file that passes through glTF-Transform keeps its learned light, to the byte of every buffer. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { NodeIO } from "@gltf-transform/core";
import { EXTTextureWebP, KHRMaterialsEmissiveStrength, KHRMaterialsSpecular } from "@gltf-transform/extensions";
import validator from "gltf-validator";
import { readExtension } from "lightwell";
import { Lightmap, NeuralRadiance, type NeuralRadianceProperty } from "lightwell/gltf-transform";
import { expect, it } from "vitest";
import { linearField, plainRoom, stillField } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";

type Json = any;
const LIGHTMAP = new Uint8Array(readFileSync(fileURLToPath(new URL("fixtures/lightmap.glb", import.meta.url))));
const OTHERS = [EXTTextureWebP, KHRMaterialsSpecular, KHRMaterialsEmissiveStrength];

/** JSON and binary chunk of a GLB. */
function open(glb: Uint8Array): { json: Json; bytes: Uint8Array } {
  const view = new DataView(glb.buffer, glb.byteOffset, glb.byteLength);
  const length = view.getUint32(12, true);
  const json = JSON.parse(new TextDecoder().decode(glb.subarray(20, 20 + length)));
  return { json, bytes: glb.subarray(28 + length) };
}

/** What the runtime reads of a file; a picture stands for the bytes of its image. */
async function learned(glb: Uint8Array) {
  const { json, bytes } = open(glb);
  const view = (index: number) => {
    const { byteOffset = 0, byteLength } = json.bufferViews[index];
    return bytes.slice(byteOffset, byteOffset + byteLength);
  };
  const texture = async (index: number) => {
    const { source, extensions } = json.textures[index];
    const image = json.images[extensions?.EXT_texture_webp?.source ?? source];
    const size = image.mimeType === "image/webp" ? 8 : 16;
    return { source: Buffer.from(view(image.bufferView)).toString("base64"), width: size, height: size };
  };
  const found = (await readExtension(json, { bufferView: async (index) => view(index).buffer, texture }))!;
  return {
    variables: found.variables,
    fields: found.fields.map(({ graph, buffers, ...rest }) => ({
      ...rest,
      nodes: graph.nodes.map(({ id, opName, inputs }) => ({ id, opName, inputs })),
      buffers: [...buffers].map(([name, { data, ...form }]) => [name, form, Array.from(data)]),
    })),
  };
}

const FILES: [string, Uint8Array][] = [
  ["a field with a lamp, and a still one", writeGlb(plainRoom({ fields: [linearField(), stillField()] }))],
  ["a light map with pictures", LIGHTMAP],
];

it.each(FILES)("keeps %s", async (_name, glb) => {
  const io = new NodeIO().registerExtensions([NeuralRadiance, Lightmap, ...OTHERS]);
  const document = await io.readBinary(glb);
  const property = document.getRoot().getExtension<NeuralRadianceProperty>("LIGHTWELL_neural_radiance");
  expect(property!.getJson().version).toBe(1);
  // A new accessor in front shifts every index.
  const first = document.createAccessor("in the way").setType("SCALAR").setArray(new Float32Array([1, 2, 3]));
  document.getRoot().listMeshes()[0]!.listPrimitives()[0]!.setAttribute("_NOTE", first);
  const written = await io.writeBinary(document);
  expect(await learned(written)).toEqual(await learned(glb));
  const [before, after] = [open(glb).json, open(written).json];
  expect(after.extensionsUsed).toEqual(expect.arrayContaining(before.extensionsUsed));
  expect(after.extensionsRequired).toBeUndefined();
  const lightmaps = ({ materials, textures }: Json) =>
    materials.map(({ extensions }: Json) => {
      const map = extensions?.MOZ_lightmap;
      return map && { ...map, index: textures[map.index] ? "there" : "missing" };
    });
  expect(lightmaps(after)).toEqual(lightmaps(before));
  const report = await validator.validateBytes(written);
  // The note on the first mesh has three numbers for four vertices; all else must be as it should.
  expect(report.issues.messages.filter((issue) => issue.severity === 0 && !issue.pointer.includes("_NOTE"))).toEqual([]);
  // Once more changes nothing.
  const again = await io.writeBinary(await io.readBinary(written));
  expect(await learned(again)).toEqual(await learned(glb));
});

it("drops the learned light without the extension: the reason why it exists", async () => {
  const io = new NodeIO().registerExtensions(OTHERS);
  const written = await io.writeBinary(await io.readBinary(FILES[0]![1]));
  expect(open(written).json.extensions?.LIGHTWELL_neural_radiance).toBeUndefined();
});

it.each([
  ["an accessor that is not there", (json: Json) => void (json.fields[0].graph.buffers.w.accessor = 99), /0\.w: expected an accessor/],
  ["a texture that is not there", (json: Json) => void (json.fields[0].graph.buffers.w.texture = 99), /textures\[99\] with a picture/],
  ["fields that are no list", (json: Json) => void (json.fields = 4), /fields: expected an array/],
])("refuses %s", async (_name, spoil, message) => {
  const io = new NodeIO().registerExtensions([NeuralRadiance, ...OTHERS]);
  const glb = writeGlb(plainRoom({ tamper: (json: Json) => spoil(json.extensions.LIGHTWELL_neural_radiance) }));
  await expect(io.readBinary(glb)).rejects.toThrow(message);
});
