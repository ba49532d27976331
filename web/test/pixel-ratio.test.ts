/** A page that moves to a screen of other pixels. Emulated screens tell no page of it: the window here is a stand-in. */

import { afterEach, expect, it, vi } from "vitest";
import { onPixelRatio } from "../runtime/src/pixel-ratio.ts";

/** Query lists of one window, by their text. */
class Query extends EventTarget {
  readonly media: string;

  constructor(media: string) {
    super();
    this.media = media;
    queries.push(this);
  }
}
let queries: Query[] = [];

function moveTo(ratio: number): void {
  const before = `(resolution: ${(globalThis as { devicePixelRatio?: number }).devicePixelRatio}dppx)`;
  vi.stubGlobal("devicePixelRatio", ratio);
  for (const query of queries.filter(({ media }) => media === before)) query.dispatchEvent(new Event("change"));
}

afterEach(() => {
  vi.unstubAllGlobals();
  queries = [];
});

it("hears of every other pixel ratio once, until it is ended", () => {
  vi.stubGlobal("matchMedia", (media: string) => new Query(media));
  moveTo(1);
  const heard: number[] = [];
  const end = onPixelRatio(() => heard.push(devicePixelRatio));
  for (const ratio of [2, 1.5, 1, 2]) moveTo(ratio);
  expect(heard).toEqual([2, 1.5, 1, 2]);
  end();
  moveTo(1);
  expect(heard).toHaveLength(4);
});
