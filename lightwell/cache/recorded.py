"""``dr.freeze`` with a way out: what cannot be recorded is traced anew each time, slower and with the same numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lightwell.backend import freeze, mi

# After so many refusals a function is traced for good.
MOST_REFUSALS = 3
# Recordings of one function before Dr.Jit warns of values that change at every call. Here none do, but tables of guides
# differ in size from integrator to integrator, and a process may make many; ten, the default, warned in benchmarks.
EXPECTED = 100


class Recorded:
    """A function of scene and arrays, recorded at its first call.

    A recording is of one scene and is thrown away when another one comes: materials of a scene that is gone give their
    numbers to those of the next, and a recording would call the wrong ones. The last scene is held for that.

    The last scene is known to all recordings of the process, because so are the numbers of materials.

    Recording is refused while materials of another scene are alive in the process and have nested ones (masks, blends):
    virtual calls could reach them, and they are not among the arguments.
    """

    scene: Any = None
    """The scene that was last played, by any recording."""
    turn = 0
    """How many times that changed."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function, self.frozen = function, freeze(function, warn_after=EXPECTED)
        self.refusals, self.recorded = 0, -1

    def __call__(self, *arguments: Any) -> Any:
        self._follow(arguments[0])
        if self.refusals < MOST_REFUSALS:
            try:
                return self.frozen(*arguments)
            except RuntimeError as error:
                if not any(words in str(error) for words in ("frozen function", "assign_with_registry")):
                    raise
                self.refusals += 1
        return self.function(*arguments)

    def _follow(self, scene: Any) -> None:
        """Begin anew where the scene is not the one that the recording is of."""
        if not isinstance(scene, mi.Scene):
            return
        if Recorded.scene is not scene:
            Recorded.scene, Recorded.turn = scene, Recorded.turn + 1
        if self.recorded != Recorded.turn:
            self.frozen = freeze(self.function, warn_after=EXPECTED)
            self.recorded, self.refusals = Recorded.turn, 0
