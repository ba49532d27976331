/** One renderer for all elements of a page: browsers allow few graphics contexts. */

import { PCFShadowMap, type PerspectiveCamera, type Scene, type ToneMapping, WebGLRenderer } from "three";
import { clearBehindGlass } from "../behind-glass.ts";
import type { LearnedScene } from "../learned-scene.ts";

/** What one picture needs. */
export interface Shot {
  readonly learned: LearnedScene;
  readonly scene: Scene;
  readonly camera: PerspectiveCamera;
  readonly toneMapping: ToneMapping;
  readonly exposure: number;
}

/** Someone who draws with it. */
export interface Client {
  /** The graphics context was lost, or is back. */
  onContext(lost: boolean): void;
}

/** Draws into a canvas of its own and copies the picture to the one of an element; there while an element is. */
export class SharedRenderer {
  private static shared: SharedRenderer | null = null;
  readonly renderer: WebGLRenderer;
  private readonly clients = new Set<Client>();

  private constructor() {
    this.renderer = new WebGLRenderer({ canvas: document.createElement("canvas"), antialias: true, alpha: true });
    clearBehindGlass(this.renderer);
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    const canvas = this.renderer.domElement;
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      for (const client of this.clients) client.onContext(true);
    });
    canvas.addEventListener("webglcontextrestored", () => {
      for (const client of this.clients) client.onContext(false);
    });
  }

  /** The page's renderer, made for the first who asks. Throws where there is no WebGL 2. */
  static join(client: Client): SharedRenderer {
    SharedRenderer.shared ??= new SharedRenderer();
    SharedRenderer.shared.clients.add(client);
    return SharedRenderer.shared;
  }

  /** The last one to leave frees it. */
  leave(client: Client): void {
    this.clients.delete(client);
    if (this.clients.size > 0 || SharedRenderer.shared !== this) return;
    SharedRenderer.shared = null;
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  /** Draw a picture and copy it to a canvas of its size. */
  draw({ learned, scene, camera, toneMapping, exposure }: Shot, canvas: HTMLCanvasElement): void {
    const { renderer } = this;
    const { width, height } = canvas;
    const source = renderer.domElement;
    if (source.width < width || source.height < height) renderer.setSize(Math.max(width, source.width), Math.max(height, source.height), false);
    renderer.toneMapping = toneMapping;
    renderer.toneMappingExposure = exposure;
    // The lower left corner of the canvas of all.
    renderer.setViewport(0, 0, width, height);
    learned.update(renderer);
    learned.render(renderer, scene, camera, width, height);
    const context = canvas.getContext("2d")!;
    context.globalCompositeOperation = "copy";
    context.drawImage(source, 0, source.height - height, width, height, 0, 0, width, height);
  }
}
