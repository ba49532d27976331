/**
 * Damaged files through the loader, both printers and the readers of probes and lens libraries; the shaders of what is accepted
 * are compiled. `LIGHTWELL_LONG_TESTS=1` asks for 300 mutants of each kind, with a random seed beside the fixed one.
 */

import { execFile } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { promisify } from "node:util";
import { afterAll, beforeAll, describe, expect, it } from "vitest";
import type { Shaders } from "../fuzz/target.ts";
import { launch, launchAlone, openPage, Site } from "./support/browser.ts";

const LONG = Boolean(process.env.LIGHTWELL_LONG_TESTS);
const MUTANTS = LONG ? 300 : 8;
const SEEDS = LONG ? [1, Math.floor(Math.random() * 2 ** 31)] : [1];
const KINDS = 10;
const FORMATS = 3;
/** Faults, of which there must be none. */
const NONE = { crashes: 0, hangs: 0, too_much_memory: 0, silent_nan: 0, uncaught: 0, failures: [] };

const run = promisify(execFile);
const entry = fileURLToPath(new URL("../fuzz/run.mjs", import.meta.url));

/** Errors of compilers for the texts of one or more fields; both take them as they would in a page. */
async function compile(shaders: readonly Shaders[]): Promise<string[]> {
  const errors: string[] = [];
  const gl = new OffscreenCanvas(1, 1).getContext("webgl2")!;
  const adapter = await navigator.gpu?.requestAdapter();
  const device = await adapter?.requestDevice();
  for (const { glsl, wgsl } of shaders) {
    for (const code of glsl) {
      const shader = gl.createShader(gl.FRAGMENT_SHADER)!;
      gl.shaderSource(shader, `#version 300 es\nprecision highp float;\nprecision highp int;\n${code}\nout vec4 color;\nvoid main() { color = vec4(0.0); }`);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) errors.push(`${gl.getShaderInfoLog(shader)}\n${code.slice(0, 2000)}`);
      gl.deleteShader(shader);
    }
    for (const code of device ? wgsl : []) {
      const info = await device!.createShaderModule({ code }).getCompilationInfo();
      for (const { type, message } of info.messages) if (type === "error") errors.push(`${message}\n${code.slice(0, 2000)}`);
    }
  }
  if (!device) errors.push("no WebGPU");
  if (gl.isContextLost()) errors.push("the context was lost");
  return errors;
}

describe.each(SEEDS)("seed %i", (seed) => {
  let folder = "";
  const site = new Site();

  beforeAll(async () => {
    folder = mkdtempSync(join(tmpdir(), "lightwell-fuzz-"));
    await site.open();
  });

  afterAll(async () => {
    rmSync(folder, { recursive: true });
    await site.close();
  });

  it(`${MUTANTS} mutants of each kind end in our own error or in shaders that compile`, async () => {
    const file = join(folder, "shaders.json");
    const { stdout } = await run(process.execPath, [entry, "--mutants", `${MUTANTS}`, "--seed", `${seed}`, "--shaders", file]);
    const counts = JSON.parse(stdout);
    expect(counts).toMatchObject(NONE);
    expect(counts.mutants).toBe(MUTANTS * KINDS * FORMATS);
    expect(Object.keys(counts.refused_by_kind)).toHaveLength(KINDS);
    expect(counts.accepted).toBeGreaterThan(MUTANTS);
    const shaders = JSON.parse(readFileSync(file, "utf8")) as Shaders[];
    expect(shaders.length).toBeGreaterThan(5);
    const browser = await (LONG ? launchAlone : launch)("swiftshader");
    const { page } = await openPage(browser);
    await page.goto(site.put("/index.html", "<!doctype html>"));
    for (let i = 0; i < shaders.length; i += 20) expect(await page.evaluate(compile, shaders.slice(i, i + 20))).toEqual([]);
    await browser.close();
  }, LONG ? 900_000 : 120_000);
});

it("a mutant that hangs, dies or is uncaught is counted", async () => {
  const { stdout } = await run(process.execPath, [entry, "--self-test", "--hang-seconds", "3"]);
  expect(JSON.parse(stdout)).toMatchObject({ mutants: 3, hangs: 1, crashes: 1, uncaught: 1 });
}, 60_000);
