/** One page with a room and functions that a test calls by name, as `window.scenario`. */

import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll } from "vitest";
import { launch, openPage, Site } from "./browser.ts";
import { bundle, modulePage } from "./bundle.ts";
import { furnishedRoom } from "./fixtures.ts";
import { writeGlb } from "./glb.ts";

export interface ScenarioPage {
  /** Messages of the console and uncaught errors, oldest first. */
  readonly errors: string[];
  readonly page: Page;
  /** Call a function of the page; messages of earlier calls are forgotten. */
  run(name: string): Promise<unknown>;
}

/** Open a page for all tests of a file; what is returned is filled in before they begin. */
export function useScenarios(module: string): ScenarioPage {
  const site = new Site();
  const opened: { browser?: Browser; page?: Page; errors: string[] } = { errors: [] };

  beforeAll(async () => {
    await site.open();
    opened.browser = await launch("llvmpipe");
    Object.assign(opened, await openPage(opened.browser));
    const glb = Buffer.from(writeGlb(furnishedRoom())).toString("base64");
    await opened.page!.goto(site.put("/index.html", modulePage(await bundle(module), `<body data-glb="${glb}">`)));
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
    async run(name) {
      opened.errors.length = 0;
      return opened.page!.evaluate((key) => window.scenario(key), name);
    },
  };
}
