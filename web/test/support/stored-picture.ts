/** Screenshots held against pictures that are kept beside the tests. */

import { existsSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname } from "node:path";
import { fileURLToPath } from "node:url";
import type { Page } from "playwright-core";

/** Write the pictures anew: look at them before they are kept. */
const STORE = Boolean(process.env.LIGHTWELL_STORE_PICTURES);

export interface Likeness {
  /** Mean difference of a channel, as a share of the range. */
  readonly mean: number;
  /** Share of channels that are off by more than a tenth of the range. */
  readonly off: number;
}

/** A stored picture and how a screenshot of the page differs from it; all zero where it is being stored. */
export async function likeness(page: Page, name: string): Promise<Likeness> {
  const path = fileURLToPath(new URL(`../pictures/${name}.png`, import.meta.url));
  // What is stored was looked at by nobody yet: it waits for everything to be there.
  if (STORE) await page.waitForTimeout(8000);
  const shot = await page.screenshot();
  if (STORE) {
    mkdirSync(dirname(path), { recursive: true });
    writeFileSync(path, shot);
  }
  if (!existsSync(path)) throw new Error(`test/pictures/${name}.png: there is none; run with LIGHTWELL_STORE_PICTURES=1 and look at it`);
  return likenessOf(page, shot, readFileSync(path));
}

/** How two encoded pictures differ; `page` is any page. */
export function likenessOf(page: Page, one: Buffer, other: Buffer): Promise<Likeness> {
  return page.evaluate(compare, [one.toString("base64"), other.toString("base64")] as const);
}

/** In the page: browsers decode pictures. */
async function compare([a, b]: readonly [string, string]): Promise<Likeness> {
  const pixels = async (text: string) => {
    const image = await createImageBitmap(new Blob([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))]));
    const context = new OffscreenCanvas(image.width, image.height).getContext("2d")!;
    context.drawImage(image, 0, 0);
    return context.getImageData(0, 0, image.width, image.height).data;
  };
  const [p, q] = [await pixels(a), await pixels(b)];
  if (p.length !== q.length) return { mean: 1, off: 1 };
  let [sum, off] = [0, 0];
  for (let i = 0; i < p.length; i++) {
    const apart = Math.abs(p[i]! - q[i]!) / 255;
    sum += apart;
    if (apart > 0.1) off++;
  }
  return { mean: sum / p.length, off: off / p.length };
}

/** Animations stand at their first moment, and are drawn a few times a second: pictures are the same at every run, and soon there. */
export async function standStill(page: Page): Promise<void> {
  await page.addInitScript(() => {
    const own = window.requestAnimationFrame.bind(window);
    window.requestAnimationFrame = (callback) => own(() => setTimeout(callback, 150, 0));
    performance.now = () => 0;
  });
}
