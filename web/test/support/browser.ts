/** A headless Chromium and a little server on 127.0.0.1. */

import { existsSync } from "node:fs";
import { createServer, type Server } from "node:http";
import type { AddressInfo } from "node:net";
import { type Browser, chromium, type Page } from "playwright-core";

const PLACES = [
  "/usr/bin/chromium",
  "/usr/bin/chromium-browser",
  "/usr/bin/google-chrome",
  "/usr/bin/google-chrome-stable",
];

/** Launch flags: every backend needs its own set (none of them may be dropped). */
export const BACKENDS = {
  swiftshader: [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--enable-unsafe-webgpu",
    "--enable-features=Vulkan",
    "--use-vulkan=swiftshader",
  ],
  llvmpipe: ["--use-angle=gl-egl", "--ignore-gpu-blocklist", "--enable-unsafe-webgpu"],
} as const;

export type Backend = keyof typeof BACKENDS;

/** Path of a Chromium on this machine; `CHROMIUM` goes first. */
export function findChromium(): string {
  const path = process.env.CHROMIUM ?? PLACES.find((place) => existsSync(place));
  if (!path) throw new Error("no Chromium found; set CHROMIUM to its path");
  return path;
}

export function launch(backend: Backend): Promise<Browser> {
  return chromium.launch({
    executablePath: findChromium(),
    args: ["--no-sandbox", "--disable-gpu-watchdog", ...BACKENDS[backend]],
  });
}

/** Performance notes of the rasterisers, on reading pixels back. */
const DRIVER_NOTE = "GL Driver Message";

/** Serves texts and bytes by path. */
export class Site {
  private readonly files = new Map<string, string | Uint8Array>();
  private readonly server: Server = createServer((request, response) => {
    const body = this.files.get(new URL(request.url ?? "/", "http://x").pathname);
    const type = typeof body === "string" ? "text/html; charset=utf-8" : "application/octet-stream";
    response.writeHead(body === undefined ? 404 : 200, { "content-type": type });
    response.end(body);
  });

  /** Start on a free port. */
  async open(): Promise<void> {
    await new Promise<void>((resolve) => this.server.listen(0, "127.0.0.1", resolve));
  }

  /** Serve `body` at `path`; returns its address. */
  put(path: string, body: string | Uint8Array): string {
    this.files.set(path, body);
    return `http://127.0.0.1:${(this.server.address() as AddressInfo).port}${path}`;
  }

  async close(): Promise<void> {
    this.server.closeAllConnections();
    await new Promise((resolve) => this.server.close(resolve));
  }
}

/** A tab that remembers its errors. */
export async function openPage(
  browser: Browser,
  width = 192,
  height = 144,
): Promise<{ page: Page; errors: string[] }> {
  const page = await browser.newPage({ viewport: { width, height } });
  const errors: string[] = [];
  page.on("pageerror", (error) => errors.push(String(error)));
  page.on("console", (message) => {
    const text = message.text();
    if (["error", "warning"].includes(message.type()) && !text.includes(DRIVER_NOTE)) errors.push(text);
  });
  return { page, errors };
}
