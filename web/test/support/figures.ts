/** Figures that tests measure, kept in `test-results/figures.json` for benchmarks/web.py. */

import { existsSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";

const FOLDER = fileURLToPath(new URL("../../test-results/", import.meta.url));
const FILE = `${FOLDER}figures.json`;

/** Keep a figure in place of an earlier one of the same name. */
export function keepFigure(name: string, value: number): void {
  const known = existsSync(FILE) ? JSON.parse(readFileSync(FILE, "utf8")) : {};
  mkdirSync(FOLDER, { recursive: true });
  writeFileSync(FILE, `${JSON.stringify({ ...known, [name]: value }, null, 1)}\n`);
}
