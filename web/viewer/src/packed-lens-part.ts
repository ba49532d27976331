/** `lens-part.ts` of the built page, which carries the lens in a script of its own (`web/lens-part.ts` makes it). */

import shared from "virtual:lens-shared";
import { decodeBase64 } from "./base64.ts";
import { gunzip } from "./gunzip.ts";
import type { LensPart } from "./lens-part.ts";

const ID = "lightwell-lens";

let loading: Promise<LensPart> | null = null;

export function loadLens(): Promise<LensPart> {
  loading ??= load();
  return loading;
}

async function load(): Promise<LensPart> {
  const packed = document.getElementById(ID)!;
  const bytes = await gunzip(decodeBase64(packed.textContent!), Number(packed.dataset.bytes), "the page's lens");
  // An inline script, which runs at once: where a policy names the hashes of scripts, no other kind can be named by its hash.
  const script = document.createElement("script");
  script.text = new TextDecoder().decode(bytes);
  document.head.append(script);
  script.remove();
  if (!window.lightwellLens) throw new Error("The content security policy of this page forbids the script of the lens: it does not name its hash.");
  const part = window.lightwellLens(shared);
  delete window.lightwellLens;
  return part;
}

declare global {
  interface Window {
    /** Set by the packed script. */
    lightwellLens?: (modules: readonly unknown[]) => LensPart;
  }
}
