import { configDefaults, defineConfig } from "vitest/config";
import { MODULES } from "./modules.ts";

/** Other versions, engines and libraries, and all that multiplies the same checks: for `make test-all`, and the benchmark. */
const LONG = ["versions", "engines", "fiber-libraries", "snippets", "three-ways"];

export default defineConfig({
  resolve: { alias: Object.entries(MODULES).map(([name, path]) => ({ find: new RegExp(`^${name}$`), replacement: path })) },
  test: {
    include: ["test/**/*.test.ts"],
    // Times are for the benchmark.
    exclude: [
      ...configDefaults.exclude,
      ...(process.env.LIGHTWELL_LONG_TESTS || process.env.LIGHTWELL_MEASURE ? [] : LONG.map((name) => `test/${name}.test.ts`)),
      ...(process.env.LIGHTWELL_MEASURE ? [] : ["test/times.test.ts"]),
    ],
    testTimeout: 60_000,
    hookTimeout: 60_000,
    // Two at once fill the waits of each other (two cores: 234 s for 280 s); times are measured by one alone.
    maxWorkers: process.env.LIGHTWELL_MEASURE ? 1 : 2,
    // Each file in a process of its own would load three.js and the rest forty times.
    isolate: false,
  },
});
