/** Times of frames by the GPU's clock, on a context that is lost and comes back. */

import { expect, it } from "vitest";
import { FrameTimer } from "../viewer/src/frame-timer.ts";

/** A context of a GPU with timestamps: it refuses nothing as real ones do, and forgets its queries when it is lost. */
function fakeContext() {
  let lost = false;
  let known = new Set<object>();
  let enabled = false;
  const gl = {
    QUERY_RESULT: 1,
    QUERY_RESULT_AVAILABLE: 2,
    refused: 0,
    isContextLost: () => lost,
    getExtension: (name: string) => (name.startsWith("EXT_disjoint") ? ((enabled = true), { TIME_ELAPSED_EXT: 3, GPU_DISJOINT_EXT: 4 }) : null),
    getParameter: (name: number) => (name === 4 ? false : "a GPU"),
    createQuery: () => {
      const query = {};
      known.add(query);
      return lost ? null : query;
    },
    beginQuery(_: number, query: object | null) {
      if (!query) throw new TypeError("parameter 2 is not of type 'WebGLQuery'");
      if (!enabled) gl.refused++;
    },
    endQuery() {},
    getQueryParameter: (query: object, name: number) => (known.has(query) ? (name === 1 ? 5e6 : true) : null),
    deleteQuery: (query: object) => void known.delete(query),
    lose(now: boolean) {
      [lost, known, enabled] = [now, new Set(), false];
    },
    open: () => known.size,
  };
  return gl;
}

it("goes on after the context was lost, and leaves no query behind", () => {
  const gl = fakeContext();
  const timer = new FrameTimer(gl as unknown as WebGL2RenderingContext);
  const frame = (now: number) => {
    timer.begin();
    timer.end(now);
  };
  frame(0);
  expect(timer.milliseconds).toBe(5);
  timer.begin();
  gl.lose(true);
  timer.end(1);
  frame(2);
  gl.lose(false);
  timer.restart();
  for (let k = 0; k < 20; k++) frame(3 + k);
  expect([gl.open(), gl.refused, timer.milliseconds]).toEqual([0, 0, 5]);
});
