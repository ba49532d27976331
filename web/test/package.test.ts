/** What is published: a package that says what it is and contains what it must, licences of others included. */

import { execFileSync } from "node:child_process";
import { existsSync, readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { beforeAll, describe, expect, it } from "vitest";
import { buildPackage } from "./support/package.ts";

const WEB = fileURLToPath(new URL("../", import.meta.url));
const RUNTIME = `${WEB}runtime/`;
const description = JSON.parse(readFileSync(`${RUNTIME}package.json`, "utf8"));

describe("the package", () => {
  let packed: string[] = [];
  beforeAll(() => {
    buildPackage();
    const listed = execFileSync("npm", ["pack", "--dry-run", "--json", "--ignore-scripts"], { cwd: RUNTIME, stdio: "pipe" });
    packed = JSON.parse(listed.toString())[0].files.map((file: { path: string }) => file.path);
  }, 240_000);

  it("holds code, types, its own licence and those of others, and nothing of the sources", () => {
    expect(packed).toEqual(expect.arrayContaining(["README.md", "LICENSE", "THIRD_PARTY.md", "package.json", "dist/index.js", "dist/index.d.ts", "dist/lightwell-viewer.js"]));
    expect(packed.filter((path) => path.startsWith("src/") || path.includes("test"))).toEqual([]);
  });

  it("has every entry that it names, with types", () => {
    for (const target of Object.values<{ types: string; default: string } | string>(description.exports)) {
      for (const path of typeof target === "string" ? [target] : [target.types, target.default]) expect([path, existsSync(RUNTIME + path)]).toEqual([path, true]);
    }
  });

  it("says which versions of three.js it works with, up to the one that the tests use", () => {
    const [, low, high] = /^>=0\.(\d+) <0\.(\d+)$/.exec(description.peerDependencies.three)!;
    const used = JSON.parse(readFileSync(`${WEB}node_modules/three/package.json`, "utf8")).version as string;
    expect(Number(low)).toBe(182);
    expect(Number(high)).toBe(Number(used.split(".")[1]) + 1);
  });

  it("carries the licences of three.js and meshoptimizer, which the element contains", () => {
    const text = readFileSync(`${RUNTIME}THIRD_PARTY.md`, "utf8");
    expect(text).toContain(readFileSync(`${WEB}node_modules/three/LICENSE`, "utf8").trim());
    expect(text).toContain("Arseny Kapoulkine");
    expect(readFileSync(`${RUNTIME}LICENSE`, "utf8")).toBe(readFileSync(`${WEB}../LICENSE`, "utf8"));
  });

  it("can be imported where there is no page", () => {
    const targets = Object.entries<{ default: string } | string>(description.exports);
    const entries = targets.flatMap(([, target]) => (typeof target === "string" ? [] : [target.default]));
    expect(entries.length).toBeGreaterThan(8);
    expect(readFileSync(`${RUNTIME}dist/scene-core.js`, "utf8").split("\n").length).toBeLessThan(5);
    const base = JSON.stringify(new URL("../runtime/", import.meta.url).href);
    const program = `for (const entry of ${JSON.stringify(entries)}) await import(new URL(entry, ${base}));`;
    execFileSync(process.execPath, ["--input-type=module", "-e", program], { stdio: "pipe" });
  });
});
