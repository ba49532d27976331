/** Modules of the package and of the page import one way, types included. */

import { readdirSync, readFileSync } from "node:fs";
import { dirname, join, normalize, relative } from "node:path";
import { fileURLToPath } from "node:url";
import { describe, expect, it } from "vitest";

const SOURCE = fileURLToPath(new URL("../runtime/src/", import.meta.url));
const PAGE = fileURLToPath(new URL("../viewer/src/", import.meta.url));
const IMPORT = /^(?:import|export)\s[^;]*?from\s+"(\.[^"]+)"|^import\s+"(\.[^"]+)"/gms;
const GLOB = /import\.meta\.glob[^(]*\(([^)]+)\)/g;

/** Every module of a folder with the modules that it names, imports of types alone included. */
function importsOf(folder: string): Map<string, string[]> {
  const files = readdirSync(folder, { recursive: true }).map(String).filter((file) => file.endsWith(".ts"));
  return new Map(
    files.map((file) => {
      const text = readFileSync(join(folder, file), "utf8");
      const found = [...text.matchAll(IMPORT)].map(([, from, bare]) => normalize(join(dirname(file), from ?? bare!)));
      const globs = [...text.matchAll(GLOB)].flatMap(([, patterns]) => [...patterns!.matchAll(/"\.\/([\w-]+)\/\*\.ts"/g)]);
      const folders = globs.map(([, name]) => `${normalize(join(dirname(file), name!))}/`);
      return [file, [...found, ...files.filter((other) => folders.some((start) => other.startsWith(start)))]];
    }),
  );
}

/** A circle of modules, as a chain that ends where it begins; empty when there is none. */
function circle(imports: ReadonlyMap<string, readonly string[]>): string[] {
  const done = new Set<string>();
  const path: string[] = [];
  const visit = (file: string): string[] => {
    if (path.includes(file)) return [...path.slice(path.indexOf(file)), file];
    if (done.has(file)) return [];
    path.push(file);
    for (const next of imports.get(file) ?? []) {
      const found = visit(next);
      if (found.length > 0) return found;
    }
    path.pop();
    done.add(file);
    return [];
  };
  for (const file of imports.keys()) {
    const found = visit(file);
    if (found.length > 0) return found;
  }
  return [];
}

describe("imports", () => {
  it("a circle would be found", () => {
    expect(circle(new Map([["a", ["b"]], ["b", ["c", "d"]], ["c", []], ["d", ["b"]]]))).toEqual(["b", "d", "b"]);
  });

  it("go one way, types too", () => {
    const imports = importsOf(SOURCE);
    expect(imports.size).toBeGreaterThan(50);
    expect(imports.get(relative(SOURCE, join(SOURCE, "graph/graph.ts")))).toContain(normalize("graph/op.ts"));
    expect(imports.get(normalize("graph/ops/common.ts"))).toContain(normalize("graph/ops/common/linear.ts"));
    expect(circle(imports)).toEqual([]);
    expect(circle(importsOf(PAGE))).toEqual([]);
  });
});
