/** Smooth edges of a picture at rest: frames whose pixels are shifted by parts of a pixel, averaged as they are displayed. */

import type { PerspectiveCamera } from "three";

/** Frames that are averaged, each with one sample of a pixel. */
const FRAMES = 24;
/** How long a picture rests before it is refined, so that a drag or a script is not slowed down; and for how long, on slow devices. */
const [DELAY_MS, MOST_MS] = [300, 4000];

/** Element of the sequence of van der Corput, in [0, 1); of two bases the points of Halton's, which fill a square evenly. */
function radicalInverse(index: number, base: number): number {
  let [value, share] = [0, 1 / base];
  for (let rest = index; rest > 0; rest = Math.floor(rest / base)) {
    value += (rest % base) * share;
    share /= base;
  }
  return value;
}

/** Shift a picture by a part of a pixel, at most half of one; `draw` draws it. */
export function shifted(camera: PerspectiveCamera, width: number, height: number, index: number, draw: () => void): void {
  const [x, y] = [radicalInverse(index, 2) - 0.5, radicalInverse(index, 3) - 0.5];
  camera.setViewOffset(width, height, x, y, width, height);
  draw();
  camera.clearViewOffset();
}

/** Asks for one frame after another once a picture rests. */
export class Refinement {
  private timer = 0;
  private requested = 0;
  private done = FRAMES;
  private end = 0;
  private readonly refine: (index: number) => void;

  /** `refine` draws frame `index`, 1, 2, …; frame 0 is the picture that rests. */
  constructor(refine: (index: number) => void) {
    this.refine = refine;
  }

  /** Whether nothing is left to be drawn. */
  get rests(): boolean {
    return this.done === FRAMES;
  }

  /** A picture was drawn that may come to rest. */
  begin(): void {
    this.stop();
    this.done = 1;
    this.end = performance.now() + DELAY_MS + MOST_MS;
    this.timer = window.setTimeout(() => this.ask(), DELAY_MS);
  }

  /** What is shown has changed, or cannot be refined. */
  stop(): void {
    clearTimeout(this.timer);
    cancelAnimationFrame(this.requested);
    this.done = FRAMES;
  }

  /** Draw the frames that are left now, as many as there is time for. */
  finish(): void {
    const { done } = this;
    this.stop();
    for (let index = done; index < FRAMES && performance.now() < this.end; index++) this.refine(index);
  }

  private ask(): void {
    this.requested = requestAnimationFrame(() => {
      this.refine(this.done);
      this.done = performance.now() > this.end ? FRAMES : this.done + 1;
      if (!this.rests) this.ask();
    });
  }
}
