/** Pictures and films of what is shown, to keep. */

import type { Viewer } from "./viewer.ts";

/** Films that browsers may write, the best first. */
const TYPES = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm", "video/mp4"];
/** How long a turn takes, seconds. */
export const TURN_SECONDS = 8;
/** Bits per second of a film: enough for noise-free pictures of a screen's size. */
const BITS = 12_000_000;

/** The canvas that is seen as a PNG. */
export function takePicture(viewer: Viewer): Promise<Blob> {
  return new Promise((resolve, reject) => {
    viewer.renderSmooth();
    // In the task that drew it: canvases forget.
    viewer.shownCanvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("The browser could not write the picture."))), "image/png");
  });
}

/**
 * Film the scene while the eye goes once around what it looks at, and put the eye back.
 *
 * Args: the viewer; how long a turn takes, seconds; told the share that is done. Resolves with a WebM (MP4 where browsers write
 * nothing else). Rejects where they write none.
 */
export async function recordTurn(viewer: Viewer, seconds = TURN_SECONDS, onProgress: (share: number) => void = () => {}): Promise<Blob> {
  const type = globalThis.MediaRecorder && TYPES.find((name) => MediaRecorder.isTypeSupported(name));
  if (!type) throw new Error("This browser cannot record a film.");
  // Frames are taken when they are drawn, not by a clock: a slow device loses none.
  const stream = viewer.shownCanvas.captureStream(0);
  const [track] = stream.getVideoTracks() as CanvasCaptureMediaStreamTrack[];
  const recorder = new MediaRecorder(stream, { mimeType: type, videoBitsPerSecond: BITS });
  const parts: Blob[] = [];
  recorder.addEventListener("dataavailable", ({ data }) => parts.push(data));
  const stopped = new Promise((resolve) => recorder.addEventListener("stop", resolve, { once: true }));
  recorder.start();
  await turn(viewer, seconds, (share) => {
    onProgress(share);
    track!.requestFrame();
    viewer.renderOnce();
  });
  // The last frame is taken when it has been shown.
  await shown();
  await shown();
  recorder.stop();
  await stopped;
  track!.stop();
  return new Blob(parts, { type: type.split(";")[0]! });
}

/** Turn the eye once around; `onStep` after every step. */
function turn(viewer: Viewer, seconds: number, onStep: (share: number) => void): Promise<void> {
  const start = performance.now();
  let turned = 0;
  return new Promise((resolve) => {
    const step = (now: number) => {
      const share = Math.min(1, Math.max(0, (now - start) / (1000 * seconds)));
      viewer.orbit(2 * Math.PI * share - turned);
      turned = 2 * Math.PI * share;
      onStep(share);
      if (share < 1) requestAnimationFrame(step);
      else resolve();
    };
    requestAnimationFrame(step);
  });
}

function shown(): Promise<void> {
  return new Promise((resolve) => void requestAnimationFrame(() => setTimeout(resolve)));
}
