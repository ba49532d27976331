/** Milliseconds per frame: from GPU timestamps where the browser gives them, else from frames in a row. */

import { isSoftware, rendererName } from "lightwell";

interface TimerExtension {
  readonly TIME_ELAPSED_EXT: number;
  readonly GPU_DISJOINT_EXT: number;
}

/** Frames further apart than this belong to different movements. */
const MAX_GAP_MS = 1000;
const HISTORY = 9;

/** Brackets the GPU work of a frame. */
export class FrameTimer {
  private readonly gl: WebGL2RenderingContext;
  private extension: TimerExtension | null;
  /** Of the frame that is being drawn. */
  private running: WebGLQuery | null = null;
  private readonly pending: WebGLQuery[] = [];
  private readonly times: number[] = [];
  private lastFrame = Number.NEGATIVE_INFINITY;

  constructor(gl: WebGL2RenderingContext) {
    this.gl = gl;
    this.extension = extensionOf(gl);
  }

  /** Median over the last frames; null before there was one. */
  get milliseconds(): number | null {
    if (this.times.length === 0) return null;
    return [...this.times].sort((a, b) => a - b)[this.times.length >> 1]!;
  }

  begin(): void {
    if (!this.extension || this.gl.isContextLost()) return;
    this.running = this.gl.createQuery();
    this.gl.beginQuery(this.extension.TIME_ELAPSED_EXT, this.running);
  }

  end(now: number): void {
    if (this.extension) {
      if (this.running) {
        this.gl.endQuery(this.extension.TIME_ELAPSED_EXT);
        this.pending.push(this.running);
        this.running = null;
      }
      this.collect(this.extension);
    } else if (now - this.lastFrame < MAX_GAP_MS) {
      this.add(now - this.lastFrame);
    }
    this.lastFrame = now;
  }

  /** Take a time that was measured elsewhere. */
  add(milliseconds: number): void {
    this.times.push(milliseconds);
    if (this.times.length > HISTORY) this.times.shift();
  }

  /** The graphics context was lost and is back: it knows neither the extension nor what it was asked. */
  restart(): void {
    this.extension = extensionOf(this.gl);
    this.running = null;
    this.pending.length = 0;
  }

  dispose(): void {
    for (const query of this.pending) this.gl.deleteQuery(query);
    this.pending.length = 0;
  }

  private collect(extension: TimerExtension): void {
    const { gl } = this;
    const disjoint = gl.getParameter(extension.GPU_DISJOINT_EXT) as boolean;
    while (this.pending.length > 0 && gl.getQueryParameter(this.pending[0]!, gl.QUERY_RESULT_AVAILABLE)) {
      const query = this.pending.shift()!;
      const nanoseconds = gl.getQueryParameter(query, gl.QUERY_RESULT) as number;
      if (!disjoint && nanoseconds > 0) this.add(nanoseconds / 1e6);
      gl.deleteQuery(query);
    }
  }
}

/** What counts the time of the GPU; null where there is none. */
function extensionOf(gl: WebGL2RenderingContext): TimerExtension | null {
  // The timestamps of a rasteriser on the CPU say nothing about the work.
  return isSoftware(rendererName(gl)) ? null : (gl.getExtension("EXT_disjoint_timer_query_webgl2") as TimerExtension | null);
}
