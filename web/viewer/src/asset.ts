/** Finds the scene and the page data: in the page, behind an address, or in a dropped file. */

import { FormatError, filterAnisotropically, LightwellLoaderPlugin, parseLearned } from "lightwell";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";
import { type GLTF, GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { decodeBase64 } from "./base64.ts";
import { gunzip } from "./gunzip.ts";
import type { Options } from "./options.ts";
import { EMPTY_PAGE, type PageData, readPageData } from "./page-data.ts";

/** A loaded scene and what belongs to it. */
export interface LoadedAsset {
  readonly gltf: GLTF;
  /** Parse the file once more: another renderer needs materials and lights of its own. */
  readonly again: () => Promise<GLTF>;
  readonly page: PageData;
  /** Size of the file. */
  readonly bytes: number;
  /** Name to show when the page data gives none. */
  readonly name: string;
}

/** Element ids of the two scripts that a bake puts into the page. */
const ASSET_ID = "lightwell-asset";
const PAGE_ID = "lightwell-page";

/** Longest time that parsing may take before the page calls the file broken. */
const PARSE_TIMEOUT_MS = 120_000;

/** Told how many bytes of a file have come, and how many there are; 0 when nobody knows. */
export type OnProgress = (loaded: number, total: number) => void;

/** The asset that the page carries or its address names; null when there is none and one should be dropped. */
export async function findAsset(options: Options, onProgress: OnProgress): Promise<LoadedAsset | null> {
  const embedded = document.getElementById(ASSET_ID);
  if (embedded?.textContent) {
    const bytes = await gunzip(decodeBase64(embedded.textContent), Number(embedded.dataset.bytes), "the page's scene");
    // The text is no longer needed and may be large.
    embedded.remove();
    return loadGlb(bytes.buffer, embeddedPage(), "");
  }
  if (options.asset) return loadUrl(options.asset, options.page, true, onProgress);
  return location.protocol === "file:" ? null : loadUrl("scene.glb", options.page, false, onProgress);
}

/** The page data of the page itself. */
function embeddedPage(): PageData {
  const text = document.getElementById(PAGE_ID)?.textContent;
  if (!text) return EMPTY_PAGE;
  return readPageData(JSON.parse(text));
}

/** The asset behind an address; null, or an error where it is required, when it is not there. */
export async function loadUrl(url: string, pageUrl: string | null, required: boolean, onProgress: OnProgress = () => {}): Promise<LoadedAsset | null> {
  const response = await fetch(url).catch(() => null);
  const isPage = response?.headers.get("content-type")?.includes("text/html");
  if (!response?.ok || isPage) {
    if (required) throw new Error(`${url}: cannot be loaded (${response ? response.status : "no answer"})`);
    return null;
  }
  const page = pageUrl ? readPageData(await (await fetch(pageUrl)).json()) : EMPTY_PAGE;
  const name = url.split("/").pop()!.replace(/\.glb$/i, "");
  return loadGlb(await readBody(response, onProgress), page, name);
}

/** The bytes of an answer, as they come. */
async function readBody(response: Response, onProgress: OnProgress): Promise<ArrayBuffer> {
  // What is sent compressed has more bytes than it says.
  const total = response.headers.has("content-encoding") ? 0 : Number(response.headers.get("content-length") ?? 0);
  const parts: Uint8Array<ArrayBuffer>[] = [];
  let loaded = 0;
  for (const reader = response.body!.getReader(); ; ) {
    const { done, value } = await reader.read();
    if (done) break;
    parts.push(value);
    loaded += value.length;
    onProgress(loaded, total);
  }
  return new Blob(parts).arrayBuffer();
}

/** Load a file that the user dropped or chose. */
export async function loadFile(file: File): Promise<LoadedAsset> {
  return loadGlb(await file.arrayBuffer(), EMPTY_PAGE, file.name.replace(/\.glb$/i, ""));
}

async function loadGlb(buffer: ArrayBuffer, page: PageData, name: string): Promise<LoadedAsset> {
  const again = () => parse(buffer);
  return { gltf: await again(), again, page, name, bytes: buffer.byteLength };
}

async function parse(buffer: ArrayBuffer): Promise<GLTF> {
  const loader = new GLTFLoader();
  loader.setMeshoptDecoder(MeshoptDecoder);
  loader.register((parser) => new LightwellLoaderPlugin(parser));
  const gltf = await withTimeout(parseLearned(loader, buffer), PARSE_TIMEOUT_MS);
  filterAnisotropically(gltf.scene);
  return gltf;
}

async function withTimeout<T>(work: Promise<T>, ms: number): Promise<T> {
  let timer = 0;
  const timeout = new Promise<never>((_, reject) => {
    timer = window.setTimeout(() => reject(new FormatError("the file could not be read in time")), ms);
  });
  return Promise.race([work, timeout]).finally(() => clearTimeout(timer));
}
