/** One page with rooms and functions that a test calls by name, as `window.scenario`, with every renderer of three.js. */

import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll } from "vitest";
import type { Kind } from "../pages/stand.ts";
import { launch, openPage, Site } from "./browser.ts";
import { bundle, modulePage } from "./bundle.ts";
import { furnishedRoom } from "./fixtures.ts";
import { writeGlb } from "./glb.ts";

/** What scenarios run with; WebGPURenderer's own fallback shares all but its shaders' language with WebGPU. */
export const KINDS: readonly Kind[] = ["webgl", "webgpu", ...(process.env.LIGHTWELL_LONG_TESTS ? (["fallback"] as const) : [])];

export interface ScenarioPage {
  /** Messages of the console and uncaught errors, oldest first. */
  readonly errors: string[];
  readonly page: Page;
  /** Call a function of the page; messages of earlier calls are forgotten. */
  run(name: string, kind: Kind): Promise<unknown>;
}

/** Open a page for all tests of a file; what is returned is filled in before they begin. `files`: GLBs beside the furnished room. */
export function useScenarios(module: string, files: Readonly<Record<string, Uint8Array>> = {}): ScenarioPage {
  const site = new Site();
  const opened: { browser?: Browser; page?: Page; errors: string[] } = { errors: [] };

  beforeAll(async () => {
    await site.open();
    opened.browser = await launch("llvmpipe");
    Object.assign(opened, await openPage(opened.browser));
    const data = Object.entries({ glb: writeGlb(furnishedRoom()), ...files }).map(([name, bytes]) => `data-${name}="${Buffer.from(bytes).toString("base64")}"`);
    await opened.page!.goto(site.put("/index.html", modulePage(await bundle(module), `<body ${data.join(" ")}>`)));
    await opened.page!.waitForFunction(() => window.scenario);
  }, 90_000);

  afterAll(async () => {
    await opened.browser?.close();
    await site.close();
  });

  return {
    get errors() {
      return opened.errors;
    },
    get page() {
      return opened.page!;
    },
    async run(name, kind) {
      opened.errors.length = 0;
      return opened.page!.evaluate(([key, renderer]) => window.scenario(key, renderer), [name, kind] as const);
    },
  };
}
