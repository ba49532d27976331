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

/** Start a browser of one's own: for tests that may bring it down. */
export function launchAlone(backend: Backend): Promise<Browser> {
  return chromium.launch({
    executablePath: findChromium(),
    args: ["--no-sandbox", "--disable-gpu-watchdog", "--disable-gpu-rasterization", ...BACKENDS[backend]],
  });
}

/** The running browsers, which end with this process: to start one costs a second of processor time. */
const running = new Map<Backend, Promise<Browser>>();

/** The browser of a backend, which all files share; `close` closes the tabs that were opened by what is returned. */
export async function launch(backend: Backend): Promise<Browser> {
  const starting = running.get(backend) ?? launchAlone(backend);
  running.set(backend, starting);
  const browser = await starting;
  const opened = new Set<{ close(): Promise<void> }>();
  const kept = <T extends { close(): Promise<void> }>(one: T): T => (opened.add(one), one);
  const own: Partial<Browser> = {
    newPage: async (options) => kept(await browser.newPage(options)),
    newContext: async (options) => kept(await browser.newContext(options)),
    close: async () => void (await Promise.all([...opened].map((one) => one.close()))),
  };
  return new Proxy(browser, {
    get: (target, name) => {
      const value = name in own ? own[name as keyof Browser] : Reflect.get(target, name, target);
      return typeof value === "function" ? value.bind(target) : value;
    },
  });
}

/** Performance notes of the rasterisers, on reading pixels back. */
const DRIVER_NOTE = "GL Driver Message";

/** Serves texts and bytes by path. */
export class Site {
  private readonly files = new Map<string, { body: string | Uint8Array; headers: Record<string, string> }>();
  private readonly server: Server = createServer((request, response) => {
    const path = new URL(request.url ?? "/", "http://x").pathname;
    const found = this.files.get(path);
    const type = typeof found?.body === "string" ? "text/html; charset=utf-8" : path.endsWith(".svg") ? "image/svg+xml" : "application/octet-stream";
    response.writeHead(found ? 200 : 404, { "content-type": type, ...(found ? { "content-length": Buffer.byteLength(found.body) } : {}), ...found?.headers });
    response.end(found?.body);
  });

  /** Start on a free port. */
  async open(): Promise<void> {
    await new Promise<void>((resolve) => this.server.listen(0, "127.0.0.1", resolve));
  }

  /** Serve `body` at `path`; returns its address. */
  put(path: string, body: string | Uint8Array, headers: Record<string, string> = {}): string {
    this.files.set(path, { body, headers });
    return `http://127.0.0.1:${(this.server.address() as AddressInfo).port}${path}`;
  }

  async close(): Promise<void> {
    this.server.closeAllConnections();
    await new Promise((resolve) => this.server.close(resolve));
  }
}

/** Longest wait for a page, milliseconds; more on a machine that does other things. */
const PAGE_TIMEOUT = Number(process.env.LIGHTWELL_PAGE_TIMEOUT ?? 30_000);

/** Pixels of a rasteriser for each pixel of a layout, where a test looks at controls and not at the picture. */
export const COARSE = 0.25;

/**
 * A tab that remembers its errors. To load another document in it costs half of the processor time of opening another tab, so that
 * tests share one where none of them changes its browser.
 */
export async function openPage(
  browser: Browser,
  width = 192,
  height = 144,
  deviceScaleFactor = 1,
): Promise<{ page: Page; errors: string[] }> {
  const page = await browser.newPage({ viewport: { width, height }, deviceScaleFactor });
  page.setDefaultTimeout(PAGE_TIMEOUT);
  const errors: string[] = [];
  page.on("pageerror", (error) => errors.push(String(error)));
  page.on("console", (message) => {
    const text = message.text();
    if (["error", "warning"].includes(message.type()) && !text.includes(DRIVER_NOTE)) errors.push(text);
  });
  return { page, errors };
}
