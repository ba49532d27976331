/** What is seen through glass where nothing is behind it. */

import { describe, expect, it } from "vitest";
import { openModule } from "./support/module-page.ts";

type Page = { behindGlass: { middle(cleared: boolean): number[] } };

describe("clear glass before nothing", () => {
  const open = openModule("behind-glass.ts", "behindGlass");
  const middle = (cleared: boolean) => open.page.evaluate((c) => (window as unknown as Page).behindGlass.middle(c), cleared);

  it("is white in three.js, and not with clearBehindGlass", async () => {
    expect((await middle(false))[0]).toBeGreaterThan(100);
    expect(Math.max(...(await middle(true)).slice(0, 3))).toBeLessThan(20);
  });
});
