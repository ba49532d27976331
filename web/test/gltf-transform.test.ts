/** A file that passes through glTF-Transform keeps its learned light, to the byte of every buffer. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { NodeIO } from "@gltf-transform/core";
import {
  EXTMeshoptCompression,
  EXTTextureWebP,
  KHRMaterialsEmissiveStrength,
  KHRMaterialsSpecular,
  KHRMaterialsTransmission,
  KHRTextureBasisu,
} from "@gltf-transform/extensions";
import validator from "gltf-validator";
import { KHR_DF_MODEL_RGBSDA, VK_FORMAT_R8G8B8A8_UNORM, createDefaultContainer, write as writeKtx2 } from "ktx-parse";
import { readExtension } from "lightwell";
import { Lightmap, type LightmapProperty, NeuralRadiance, type NeuralRadianceProperty } from "lightwell/gltf-transform";
import { MeshoptDecoder, MeshoptEncoder } from "meshoptimizer";
import { expect, it } from "vitest";
import { launch, openPage, Site } from "./support/browser.ts";
import { bundle, modulePage } from "./support/bundle.ts";
import { pageWith } from "./support/page.ts";
import { linearField, plainRoom, stillField } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";

type Json = any;
const LIGHTMAP = new Uint8Array(readFileSync(fileURLToPath(new URL("fixtures/lightmap.glb", import.meta.url))));
const OTHERS = [EXTTextureWebP, KHRMaterialsSpecular, KHRMaterialsTransmission, KHRMaterialsEmissiveStrength];

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
    fields: [...found.fields, ...found.probes].map(({ graph, buffers, ...rest }) => ({
      ...rest,
      nodes: graph.nodes.map(({ id, opName, inputs }) => ({ id, opName, inputs })),
      buffers: [...buffers].map(([name, { data, ...form }]) => [name, form, Array.from(data)]),
    })),
  };
}

/** A grey picture of one texel, and the texture that is what surrounds the scene. */
const GREY = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNoAAAAggCBd81ytgAAAABJRU5ErkJggg==";
const surrounded = (json: Json) => {
  Object.assign(json, { images: [{ uri: `data:image/png;base64,${GREY}` }], textures: [{ source: 0 }] });
  json.extensions.LIGHTWELL_neural_radiance.environment = { radiance: [2, 2, 2], texture: 0 };
};

const FILES: [string, Uint8Array][] = [
  ["a field with a lamp, and a still one", writeGlb(plainRoom({ fields: [linearField(), stillField()] }))],
  ["a light map with pictures", LIGHTMAP],
  ["probes beside a field", writeGlb(plainRoom({ fields: [stillField()], probes: [{ ...linearField(), name: "air" }, linearField()] }))],
];

it.each(FILES)("keeps %s", async (_name, glb) => {
  const io = new NodeIO().registerExtensions([NeuralRadiance, Lightmap, ...OTHERS]);
  const document = await io.readBinary(glb);
  const property = document.getRoot().getExtension<NeuralRadianceProperty>("LIGHTWELL_neural_radiance");
  expect(property!.getJson().version).toBe(open(glb).json.extensions.LIGHTWELL_neural_radiance.probes ? 2 : 1);
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

/** The light map's file with its geometry and its weights in EXT_meshopt_compression. */
async function compressed(glb: Uint8Array): Promise<Uint8Array> {
  await MeshoptEncoder.ready;
  const io = new NodeIO().registerExtensions([NeuralRadiance, Lightmap, EXTMeshoptCompression, ...OTHERS]);
  io.registerDependencies({ "meshopt.encoder": MeshoptEncoder, "meshopt.decoder": MeshoptDecoder });
  const document = await io.readBinary(glb);
  const { QUANTIZE: method } = EXTMeshoptCompression.EncoderMethod;
  document.createExtension(EXTMeshoptCompression).setRequired(true).setEncoderOptions({ method });
  return io.writeBinary(document);
}

it("is compressed by meshopt, and comes back to the byte", async () => {
  await MeshoptDecoder.ready;
  const small = await compressed(LIGHTMAP);
  expect(open(small).json.extensionsRequired).toContain("EXT_meshopt_compression");
  const io = new NodeIO().registerExtensions([NeuralRadiance, Lightmap, EXTMeshoptCompression, ...OTHERS]);
  const document = await io.registerDependencies({ "meshopt.decoder": MeshoptDecoder }).readBinary(small);
  for (const extension of document.getRoot().listExtensionsUsed()) {
    if (extension.extensionName === "EXT_meshopt_compression") extension.dispose();
  }
  expect(await learned(await io.writeBinary(document))).toEqual(await learned(LIGHTMAP));
});

it("shows the same picture when it is compressed by meshopt", async () => {
  const site = new Site();
  await site.open();
  const browser = await launch("swiftshader");
  const seen: number[][] = [];
  for (const [k, glb] of [LIGHTMAP, await compressed(LIGHTMAP)].entries()) {
    const { page, errors } = await openPage(browser, 64, 48);
    await page.goto(`${site.put(`/${k}.html`, pageWith(glb))}?size=64x48&tonemap=none&exposure=1&dither=0&samples=0&ui=0`);
    await page.evaluate(() => window.lightwell.ready);
    seen.push(await page.evaluate(() => Array.from(window.lightwell.readPixels().data)));
    expect(errors).toEqual([]);
    await page.close();
  }
  await browser.close();
  await site.close();
  expect(new Set(seen[0]).size).toBeGreaterThan(20);
  expect(seen[1]).toEqual(seen[0]);
});

/** 4 x 4 texels without compression, as a KTX2 file. */
function ktx2(rgba: readonly number[]): Uint8Array {
  const container = createDefaultContainer();
  const [width, height] = [4, 4];
  const levelData = Uint8Array.from({ length: 4 * width * height }, (_, i) => rgba[i % 4]!);
  Object.assign(container, { vkFormat: VK_FORMAT_R8G8B8A8_UNORM, pixelWidth: width, pixelHeight: height, typeSize: 1, levelCount: 1 });
  container.levels = [{ levelData, uncompressedByteLength: levelData.byteLength }];
  const [descriptor] = container.dataFormatDescriptor;
  Object.assign(descriptor!, { colorModel: KHR_DF_MODEL_RGBSDA, transferFunction: 1, texelBlockDimension: [0, 0, 0, 0], bytesPlane: [4, 0, 0, 0, 0, 0, 0, 0] });
  descriptor!.samples = [0, 1, 2, 15].map((channelType, i) => ({
    channelType, bitOffset: 8 * i, bitLength: 7, samplePosition: [0, 0, 0, 0], sampleLower: 0, sampleUpper: 255,
  })) as never;
  return writeKtx2(container);
}

it("carries an ordinary light map as KTX2, for which the loader brings three's decoder", async () => {
  const io = new NodeIO().registerExtensions([NeuralRadiance, Lightmap, KHRTextureBasisu, ...OTHERS]);
  const document = await io.readBinary(LIGHTMAP);
  document.createExtension(KHRTextureBasisu).setRequired(true);
  const map = document.getRoot().listMaterials()[0]!.getExtension<LightmapProperty>("MOZ_lightmap")!.getLightmapTexture()!;
  map.setMimeType("image/ktx2").setImage(ktx2([200, 100, 50, 255]));
  const glb = await io.writeBinary(document);
  expect(open(glb).json.images.map((image: Json) => image.mimeType)).toContain("image/ktx2");
  const site = new Site();
  await site.open();
  const browser = await launch("swiftshader");
  const { page, errors } = await openPage(browser, 32, 32);
  await page.goto(site.put("/ktx2.html", modulePage(await bundle("pages/ktx2.ts"))));
  const found = await page.evaluate((text) => window.lightmapsOf(text), Buffer.from(glb).toString("base64"));
  await browser.close();
  await site.close();
  expect(errors).toEqual([]);
  expect(found).toEqual(found.map(() => ({ size: [4, 4], texel: [200, 100, 50, 255], colorSpace: "", channel: 1 })));
  expect(found.length).toBe(2);
});

it("ships a configuration for the command line", async () => {
  const text = readFileSync(fileURLToPath(new URL("../runtime/gltf-transform.config.mjs", import.meta.url)), "utf8");
  expect(text).toContain('from "lightwell/gltf-transform"');
  const { default: config } = await import("../runtime/gltf-transform.config.mjs");
  const io = new NodeIO().registerExtensions(config.extensions);
  const glb = await io.writeBinary(await io.readBinary(LIGHTMAP));
  expect(await learned(glb)).toEqual(await learned(LIGHTMAP));
  expect(open(glb).json.extensionsUsed).toEqual(expect.arrayContaining(["LIGHTWELL_neural_radiance", "MOZ_lightmap"]));
});

/** A room of version 2 with two animations; the second node slides, and the time of the second animation is a variable. */
function moving(): Uint8Array {
  const numbers = [
    { values: [0, 1], type: "SCALAR" as const },
    { values: [0, 0, 0, 0, 1, 0], type: "VEC3" as const },
  ];
  const tamper = (json: Json) => {
    const input = json.accessors.length - 2;
    const clip = (name: string, node: number) => ({
      name,
      samplers: [{ input, output: input + 1 }],
      channels: [{ sampler: 0, target: { node, path: "translation" } }],
    });
    json.animations = [clip("Close", 2), clip("Open", 3)];
    json.nodes[1].name = "Door";
    const extension = json.extensions.LIGHTWELL_neural_radiance;
    extension.version = 2;
    const door = { name: "Door", kind: "node", node: 1, path: "translation", axis: [0, 1, 0], range: [0, 1], unit: "metres", initial: 0 };
    extension.variables.push(door, { name: "Open", kind: "clip", animation: 1, range: [0, 1], unit: "share", initial: 0 });
  };
  return writeGlb(plainRoom({ numbers, tamper }));
}

it("keeps what moves, though nodes and animations before it are removed", async () => {
  const io = new NodeIO().registerExtensions([NeuralRadiance, ...OTHERS]);
  const document = await io.readBinary(moving());
  document.getRoot().listNodes()[0]!.dispose();
  document.getRoot().listAnimations()[0]!.dispose();
  const { json } = open(await io.writeBinary(document));
  const [, door, clip] = json.extensions.LIGHTWELL_neural_radiance.variables;
  expect([json.nodes[door.node].name, json.animations[clip.animation].name]).toEqual(["Door", "Open"]);
  expect([door.node, clip.animation]).toEqual([0, 0]);
  document.getRoot().listAnimations()[0]!.dispose();
  await expect(io.writeBinary(document)).rejects.toThrow("variables[2].animation: expected its animation, which was removed; keep it, or bake without this variable");
});

it("refuses a node that moves and is not there", async () => {
  const glb = writeGlb(
    plainRoom({
      tamper: (json: Json) => {
        const extension = json.extensions.LIGHTWELL_neural_radiance;
        extension.variables.push({ name: "Door", kind: "node", node: 99, path: "translation", axis: [0, 1, 0], range: [0, 1], unit: "metres", initial: 0 });
      },
    }),
  );
  const io = new NodeIO().registerExtensions([NeuralRadiance, ...OTHERS]);
  await expect(io.readBinary(glb)).rejects.toThrow("variables[1].node: expected the node of this number in the file");
});

it("keeps what surrounds a scene, with its picture", async () => {
  const io = new NodeIO().registerExtensions([NeuralRadiance, ...OTHERS]);
  const document = await io.readBinary(writeGlb(plainRoom({ tamper: surrounded })));
  // A texture in front shifts the index.
  const first = document.createTexture("in the way").setImage(new Uint8Array(Buffer.from(GREY, "base64"))).setMimeType("image/png");
  document.getRoot().listMaterials()[0]!.setBaseColorTexture(first);
  const property = document.getRoot().getExtension<NeuralRadianceProperty>("LIGHTWELL_neural_radiance")!;
  const picture = property.getTexture("environment")!;
  expect(Buffer.from(picture.getImage()!).toString("base64")).toBe(GREY);
  picture.setName("sky");
  const { json } = open(await io.writeBinary(document));
  const { environment } = json.extensions.LIGHTWELL_neural_radiance;
  expect(environment).toEqual({ radiance: [2, 2, 2], texture: expect.any(Number) });
  expect(json.images[json.textures[environment.texture].source].name).toBe("sky");
});
