"""``dr.freeze`` with a fallback: a function that cannot be recorded is traced at every call, with the same result."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lightwell.backend import freeze, mi

# Failures after which a function is always traced.
MOST_REFUSALS = 3
# Recordings of one function before Dr.Jit warns of values that change at every call. Here none do, but guide tables
# differ in size between integrators, and a process may make many; the default of ten caused warnings in benchmarks.
EXPECTED = 100


class Recorded:
    """A function of a scene and arrays that is recorded at its first call.

    A recording belongs to one scene and is discarded when another one is passed: Mitsuba reuses the registry numbers of
    deleted materials, and an old recording would call the wrong ones. The last scene is kept alive for that reason. It
    is shared by all recordings of the process, because registry numbers are.

    Recording fails while materials of another scene with nested ones (masks, blends) exist in the process: virtual
    calls could reach them, and they are not among the arguments.
    """

    scene: Any = None
    """Scene of the last call of any recording."""
    turn = 0
    """How many times the scene changed."""

    def __init__(self, function: Callable[..., Any]) -> None:
        """Prepare a recording.

        Args:
            function: Function whose first argument is the scene.
        """
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
        """Discard the recording when the scene is not the recorded one."""
        if not isinstance(scene, mi.Scene):
            return
        if Recorded.scene is not scene:
            Recorded.scene, Recorded.turn = scene, Recorded.turn + 1
        if self.recorded != Recorded.turn:
            self.frozen = freeze(self.function, warn_after=EXPECTED)
            self.recorded, self.refusals = Recorded.turn, 0
