/** Builds `runtime/dist` where it is older than the sources. */

import { execFileSync } from "node:child_process";
import { existsSync, readdirSync, statSync } from "node:fs";
import { join } from "node:path";
import { fileURLToPath } from "node:url";

const WEB = fileURLToPath(new URL("../../", import.meta.url));
/** What the build writes last. */
const LAST = join(WEB, "runtime/dist/index.d.ts");

const newest = (folder: string): number =>
  Math.max(...readdirSync(folder, { recursive: true }).map((file) => statSync(join(folder, String(file))).mtimeMs));

/** Build the package unless it is up to date. */
export function buildPackage(): void {
  const sources = Math.max(newest(join(WEB, "runtime/src")), statSync(join(WEB, "package.json")).mtimeMs);
  if (existsSync(LAST) && statSync(LAST).mtimeMs > sources) return;
  execFileSync("npm", ["run", "-s", "build:package"], { cwd: WEB, stdio: "pipe" });
}
