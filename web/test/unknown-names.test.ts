/** Names that nothing of a file has are said once, with those that there are. */

import { afterEach, expect, it, vi } from "vitest";
import { isForeign, UnknownNames } from "../runtime/src/unknown-names.ts";

const DAY = { variable: { kind: "sun", sky: { hours: [4, 12, 20] } } };
const scene = { lamps: [DAY], switches: [{ name: "desk" }, { name: "cove" }], movers: [{ name: "Door" }] };
const said = vi.spyOn(console, "warn").mockImplementation(() => {});
afterEach(() => said.mockClear());

const names = () => new UnknownNames("LearnedScene", scene as never, ["door"], "environmentRotation");

it("says a misspelled short form once, with what varies", () => {
  const unknown = names();
  for (let k = 0; k < 2; k++) unknown.props(["dor", "door", "position", "lamp"], (name) => name === "position");
  expect(said.mock.calls.flat()).toEqual([
    "LearnedScene: 'dor' is no property, and nothing of this name varies in the file; what varies: 'door', 'day', 'lamps', 'movers'",
    "LearnedScene: 'lamp' is no property, and nothing of this name varies in the file; what varies: 'door', 'day', 'lamps', 'movers'",
  ]);
});

it("says lamps and movers that are not there, each once", () => {
  const unknown = names();
  for (let k = 0; k < 2; k++) {
    unknown.lamps(["desk", "dsek"]);
    unknown.movers(["Door", "Dor"]);
  }
  expect(said.mock.calls.flat()).toEqual([
    "LearnedScene: 'dsek' is no lamp of the file; there are: 'desk', 'cove'",
    "LearnedScene: 'Dor' is no mover of the file; there are: 'Door'",
  ]);
});

it("leaves attributes of other libraries alone", () => {
  expect(["data-id", "aria-label", "v-if", "x-on", "@click", ":key", "_ngcontent-abc", "onclick", "hx-get"].every(isForeign)).toBe(true);
  expect(["dor", "lamp", "sliding-dor", "day"].some(isForeign)).toBe(false);
});
