/** The committed page is what the sources build. */

import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import validator from "gltf-validator";
import { build } from "vite";
import { expect, it } from "vitest";
import { furnishedRoom } from "./support/fixtures.ts";
import { writeGlb } from "./support/glb.ts";
import { BUILT_PAGE } from "./support/page.ts";

it("lightwell/viewer/index.html is up to date (npm run build)", async () => {
  const outDir = mkdtempSync(join(tmpdir(), "lightwell-build-"));
  const configFile = fileURLToPath(new URL("../vite.config.ts", import.meta.url));
  await build({ configFile, logLevel: "error", build: { outDir } });
  expect(readFileSync(join(outDir, "index.html"), "utf8") === readFileSync(BUILT_PAGE, "utf8")).toBe(true);
  rmSync(outDir, { recursive: true });
});

it("lightwell/graph/exporter.js is up to date (npm run build)", async () => {
  const outDir = mkdtempSync(join(tmpdir(), "lightwell-build-"));
  const configFile = fileURLToPath(new URL("../vite.exporter.config.ts", import.meta.url));
  await build({ configFile, logLevel: "error", build: { outDir } });
  const built = fileURLToPath(new URL("../../lightwell/graph/exporter.js", import.meta.url));
  expect(readFileSync(join(outDir, "exporter.js"), "utf8") === readFileSync(built, "utf8")).toBe(true);
  rmSync(outDir, { recursive: true });
});

it("the built page has one place for data and loads nothing", () => {
  const html = readFileSync(BUILT_PAGE, "utf8");
  expect(html.split("<!--lightwell-data-->")).toHaveLength(2);
  expect(html).not.toMatch(/<(script|link|img)[^>]+(src|href)="(?!data:)/);
});

it("the fixtures are valid glTF", async () => {
  const report = await validator.validateBytes(writeGlb(furnishedRoom()));
  expect(report.issues.messages.filter((issue) => issue.severity < 2)).toEqual([]);
});
