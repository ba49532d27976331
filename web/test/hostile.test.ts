/** Broken and hostile files end in a readable message, never in a hang or a crash. */

import { FormatError, LightwellLoaderPlugin, parseLearned } from "lightwell";
import type { Browser } from "playwright-core";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { afterAll, beforeAll, describe, expect, it } from "vitest";
import { manyMorphs } from "../fuzz/bombs.ts";
import { launch, openPage, Site } from "./support/browser.ts";
import { plainRoom } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";
import { pageWith } from "./support/page.ts";

type Json = any;
const tampered = (tamper: (json: Json) => void) => writeGlb(plainRoom({ tamper }));
const extension = (json: Json) => json.extensions.LIGHTWELL_neural_radiance;
const field = (json: Json) => extension(json).fields[0];
const buffer = (json: Json) => field(json).graph.buffers.w;
const accessor = (json: Json) => json.accessors[buffer(json).accessor];

/** What is wrong, the file, and a part of the message. */
const CASES: [name: string, make: () => Uint8Array, message: RegExp][] = [
  ["no GLB", () => new TextEncoder().encode("this is not a scene at all"), /expected a binary glTF/],
  ["an empty file", () => new Uint8Array(3), /expected a binary glTF/],
  ["a cut file", () => writeGlb(plainRoom()).slice(0, 3000), /cut short/],
  ["another version", () => tampered((json) => void (extension(json).version = 7)), /version: expected 1/],
  [
    "fields that are no array",
    () => tampered((json) => void (extension(json).fields = {})),
    /fields: expected an array/,
  ],
  [
    "an unknown role",
    () => tampered((json) => void (field(json).role = "magic")),
    /role: expected "indirect" or "static"/,
  ],
  [
    "a variable that is not there",
    () => tampered((json) => void (field(json).variable = 3)),
    /variable: expected/,
  ],
  [
    "a box inside out",
    () => tampered((json) => void (extension(json).variables[0].low = [9, 9, 9])),
    /low: expected/,
  ],
  [
    "an accessor that is not there",
    () => tampered((json) => void (buffer(json).accessor = 999)),
    /accessor: expected/,
  ],
  [
    "an accessor past its bytes",
    () => tampered((json) => void (accessor(json).byteOffset = 4096)),
    /accessors\[\d+\]: expected \d+ bytes, found \d+ in bufferViews/,
  ],
  ["a wrong count", () => tampered((json) => void (buffer(json).shape = [3, 7])), /count: expected 21/],
  [
    "an absurd shape",
    () => tampered((json) => void (buffer(json).shape = [60000, 60000])),
    /shape: expected/,
  ],
  [
    "a wrong component type",
    () => tampered((json) => void (accessor(json).componentType = 5125)),
    /componentType/,
  ],
  ["an unknown op", () => tampered((json) => void (field(json).graph.nodes[0].op = "eval")), /op/],
  [
    "a node that names a later one",
    () => tampered((json) => void (field(json).graph.nodes[0].inputs = ["y"])),
    /earlier nodes/,
  ],
  [
    "a segment of another width",
    () => tampered((json) => void (field(json).graph.outputs.segment = "y")),
    /outputs.segment: expected a value of width 1/,
  ],
  ["nodes in a circle", () => tampered((json) => void (json.nodes[0].children = [0])), /ancestor/],
  [
    "an accessor count beyond memory",
    () => tampered((json) => void (json.accessors[0].count = 4e9)),
    /count: expected/,
  ],
  [
    "a picture elsewhere",
    () =>
      tampered((json) => {
        json.images = [{ uri: "https://example.invalid/a.png" }];
        json.textures = [{ source: 0 }];
        json.materials[0].pbrMetallicRoughness.baseColorTexture = { index: 0 };
      }),
    /self-contained/,
  ],
  ["morph targets of one accessor", () => tampered((json) => manyMorphs(json)), /targets: expected at most 268435456 bytes of morph targets up to here, found 163840000000/],
  ["some morph targets of many vertices", () => tampered((json) => manyMorphs(json, 5_000_000, 2)), /targets: expected at most 268435456 bytes of morph targets up to here, found 320000000/],
];

it.each(CASES)("%s is refused in one line", async (_name, make, message) => {
  const loader = new GLTFLoader().register((parser) => new LightwellLoaderPlugin(parser));
  const refused = await parseLearned(loader, make().slice().buffer).then(() => null, (error: unknown) => error);
  expect(refused).toBeInstanceOf(FormatError);
  expect((refused as Error).message).toMatch(message);
  expect((refused as Error).message).not.toContain("\n");
});

/** Cases of the page: not a file, an extension that is wrong, a document that is; all of them in the long tests. */
const ON_PAGE = process.env.LIGHTWELL_LONG_TESTS ? CASES : CASES.filter(([name]) => ["a cut file", "an unknown op", "nodes in a circle"].includes(name));

describe("hostile files", () => {
  let browser: Browser;
  let tab: Awaited<ReturnType<typeof openPage>>;
  const site = new Site();

  beforeAll(async () => {
    browser = await launch("llvmpipe");
    await site.open();
    tab = await openPage(browser, 96, 64);
  });

  afterAll(async () => {
    await browser?.close();
    await site.close();
  });

  it.each(ON_PAGE)("%s is said on the page", async (_name, make, message) => {
    const { page, errors } = tab;
    await page.goto(site.put("/page.html", pageWith(make())));
    const failed = await page.evaluate(() =>
      window.lightwell.ready.then(
        () => "",
        (error: Error) => error.message,
      ),
    );
    expect(failed).toMatch(message);
    expect(await page.locator(".status[role=alert]").innerText()).toMatch(message);
    expect(errors).toEqual([]);
  });
});
