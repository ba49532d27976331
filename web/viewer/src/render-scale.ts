/** Draws fewer pixels while something moves on a slow device, and all of them once it rests. */

/** A frame slower than this while moving lowers the scale; one faster than `FAST_MS` raises it. */
const SLOW_MS = 45;
const FAST_MS = 20;
const SMALLEST = 0.4;
const REST_MS = 220;

/** The share of the canvas' width and height that is rendered. */
export class RenderScale {
  private scale = 1;
  private movingUntil = Number.NEGATIVE_INFINITY;
  private lastFrame = Number.NEGATIVE_INFINITY;
  private timer = 0;
  private readonly enabled: boolean;
  private readonly onRest: () => void;

  /** `onRest` is called when a full frame is due. */
  constructor(enabled: boolean, onRest: () => void) {
    this.enabled = enabled;
    this.onRest = onRest;
  }

  /** Something moves. */
  touch(): void {
    if (!this.enabled) return;
    this.movingUntil = performance.now() + REST_MS;
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.onRest(), REST_MS + 10);
  }

  /** The scale of the frame that is drawn now. */
  factor(now: number): number {
    const elapsed = now - this.lastFrame;
    this.lastFrame = now;
    if (now > this.movingUntil) return 1;
    if (elapsed > SLOW_MS && elapsed < 10 * REST_MS) this.scale = Math.max(SMALLEST, this.scale * 0.8);
    else if (elapsed < FAST_MS) this.scale = Math.min(1, this.scale * 1.05);
    return this.scale;
  }

  dispose(): void {
    clearTimeout(this.timer);
  }
}
