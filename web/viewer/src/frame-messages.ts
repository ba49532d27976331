/** The page in a frame: the page around it may ask what is shown, and say what to show (docs/web.md, *In a frame*). */

import { readOptions } from "./options.ts";
import { applyState, type PageState, STATE_NAMES, stateOf } from "./page-state.ts";
import type { Viewer } from "./viewer.ts";

/** What the page around the frame sends. */
export interface FrameRequest {
  readonly lightwell: "get" | "set";
  /** Comes back with the answer. */
  readonly id?: unknown;
  /** For `set`: the options of the address that are to change, as the address writes them. */
  readonly state?: PageState;
}

/** What it is sent: `ready` once, `change` when something else is shown, `state` or `error` as an answer. */
export type FrameAnswer =
  | { readonly lightwell: "ready" | "change" | "state"; readonly id?: unknown; readonly state: PageState }
  | { readonly lightwell: "error"; readonly id?: unknown; readonly message: string };

const MAX_TEXT = 4096;

/** Answer the page around this one, when there is one; its messages alone are taken. */
export function answerFrame(viewer: Viewer, ready: Promise<void>): void {
  if (parent === window) return;
  // A file or a sandbox has no origin to name, and what is shown is no secret from the page that chose it.
  const send = (answer: FrameAnswer) => parent.postMessage(answer, "*");
  addEventListener("message", (event: MessageEvent<FrameRequest>) => {
    if (event.source !== parent || typeof event.data !== "object" || event.data === null) return;
    const { lightwell, id, state } = event.data;
    if (lightwell !== "get" && lightwell !== "set") return;
    const done = lightwell === "set" ? setState(viewer, state) : Promise.resolve();
    done.then(
      () => send({ lightwell: "state", id, state: stateOf(viewer) }),
      (error: Error) => send({ lightwell: "error", id, message: error.message }),
    );
  });
  let told = "";
  const tell = () => {
    const state = stateOf(viewer);
    if (JSON.stringify(state) === told) return;
    told = JSON.stringify(state);
    send({ lightwell: "change", state });
  };
  ready.then(
    () => {
      send({ lightwell: "ready", state: stateOf(viewer) });
      viewer.on("frame", tell);
    },
    (error: Error) => send({ lightwell: "error", message: error.message }),
  );
}

/** Show a state; throws when it is not one. */
async function setState(viewer: Viewer, state: unknown): Promise<void> {
  const entries = Object.entries(typeof state === "object" && state !== null ? state : {});
  const query = new URLSearchParams();
  for (const [name, value] of entries) {
    const known = (STATE_NAMES as readonly string[]).includes(name);
    if (!known) throw new Error(`state.${name.slice(0, 40)}: expected one of ${STATE_NAMES.join(", ")}`);
    if (typeof value !== "string" || value.length > MAX_TEXT) throw new Error(`state.${name}: expected a text as the page's address has it`);
    query.set(name, value);
  }
  if (entries.length === 0) throw new Error(`state: expected an object with some of ${STATE_NAMES.join(", ")}`);
  const options = readOptions(query.toString());
  await applyState(viewer, query.has("half") ? options : { ...options, half: viewer.half });
}
