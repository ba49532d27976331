/** A page with one module of `test/pages`, open for all tests of a file or a group. */

import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, expect } from "vitest";
import { launch, openPage, Site } from "./browser.ts";
import { bundle, modulePage } from "./bundle.ts";

export interface ModulePage {
  readonly page: Page;
  readonly site: Site;
}

/** Open the page before the tests and close it after them; its errors fail them. `global`: what `window` has when it is ready. */
export function openModule(module: string, global: string): ModulePage {
  const site = new Site();
  let browser: Browser | null = null;
  let opened: Page | null = null;
  let errors: string[] = [];

  beforeAll(async () => {
    await site.open();
    browser = await launch("swiftshader");
    ({ page: opened, errors } = await openPage(browser));
    await opened.goto(site.put("/index.html", modulePage(await bundle(`pages/${module}`))));
    await opened.waitForFunction((name) => name in window, global);
  }, 180_000);

  afterAll(async () => {
    await browser?.close();
    await site.close();
    expect(errors).toEqual([]);
  });

  return {
    get page() {
      if (!opened) throw new Error("openModule: the page is open in tests alone");
      return opened;
    },
    site,
  };
}
