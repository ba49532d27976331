/** The page for everyone: WCAG 2.2 AA as far as axe can tell, nothing that lies over something else, keys that do what the mouse does. */

import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import type { Browser, Page } from "playwright-core";
import { afterAll, beforeAll, describe, expect, it } from "vitest";
import { COARSE, launch, openPage, Site } from "./support/browser.ts";
import { keepFigure } from "./support/figures.ts";
import { furnishedRoom, linearField, stillField } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";
import { pageWith } from "./support/page.ts";

const AXE = readFileSync(fileURLToPath(new URL("../node_modules/axe-core/axe.min.js", import.meta.url)), "utf8");
const SIZES = { phone: [390, 780], "phone on its side": [780, 390], desktop: [1200, 720] } as const;

let browser: Browser;
let url = "";
let page: Page;
const site = new Site();

beforeAll(async () => {
  await site.open();
  browser = await launch("llvmpipe");
  url = site.put("/page.html", pageWith(writeGlb(furnishedRoom({ fields: [linearField(), stillField()] })), { title: "Furnished room", views: [] }));
  ({ page } = await openPage(browser, ...SIZES.phone, COARSE));
}, 60_000);

afterAll(async () => {
  await browser?.close();
  await site.close();
});

async function open([width, height]: readonly [number, number]): Promise<void> {
  await page.setViewportSize({ width, height });
  await page.goto(`${url}?mode=learned`);
  await page.evaluate(() => window.lightwell.ready);
}

/** What axe finds wrong, in one line each. */
async function violations(page: Page): Promise<string[]> {
  await page.evaluate(AXE);
  return page.evaluate(async () => {
    const axe = (window as unknown as { axe: { run(root: Document, options: object): Promise<{ violations: any[]; passes: any[] }> } }).axe;
    const { violations: found, passes } = await axe.run(document, { runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"] });
    if (passes.length < 10) return ["axe checked next to nothing"];
    return found.flatMap(({ id, nodes }) => nodes.map((node: any) => `${id}: ${node.target.join(" ")}: ${node.failureSummary}`));
  });
}

/** Pairs of visible controls of which one lies over the other. */
function overlaps(): string[] {
  const shown = [...document.querySelectorAll<HTMLElement>("button, input, select, a[href], h1, summary")].filter((element) => {
    const { width, height } = element.getBoundingClientRect();
    return width > 0 && height > 0 && element.checkVisibility({ checkOpacity: true, checkVisibilityCSS: true });
  });
  const found: string[] = [];
  for (const [i, a] of shown.entries()) {
    for (const b of shown.slice(i + 1)) {
      if (a.contains(b) || b.contains(a)) continue;
      const [p, q] = [a.getBoundingClientRect(), b.getBoundingClientRect()];
      const [x, y] = [Math.min(p.right, q.right) - Math.max(p.left, q.left), Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top)];
      // What scrolls inside of a panel is cut off by it.
      if (x > 2 && y > 2 && !(a.closest("aside, .panel") && a.closest("aside, .panel") !== b.closest("aside, .panel"))) found.push(`${a.outerHTML.slice(0, 80)} | ${b.outerHTML.slice(0, 80)}`);
    }
  }
  return found;
}

describe.each(Object.entries(SIZES))("on a %s", (name, size) => {
  beforeAll(() => open(size), 60_000);

  it("no control lies over another one", async () => {
    expect(await page.evaluate(overlaps)).toEqual([]);
  });

  it("axe finds nothing, with the panel and with the help open", async () => {
    const found = await violations(page);
    await page.keyboard.press("?");
    found.push(...(await violations(page)));
    keepFigure(`axe on a ${name}`, found.length);
    expect(found).toEqual([]);
  });

  it.each(name === "desktop" ? [""] : [])("what is wrong would be found", async () => {
    await page.keyboard.press("Escape");
    await page.evaluate(() => {
      const button = document.createElement("button");
      button.style.cssText = "position:fixed;inset:0;width:90px;height:90px";
      document.body.append(button);
    });
    expect(await violations(page)).toEqual([expect.stringContaining("button-name")]);
    expect(await page.evaluate(overlaps)).not.toEqual([]);
  });
});
