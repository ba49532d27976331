"""``dr.freeze`` with a way out: what cannot be recorded is traced anew each time, slower and with the same numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lightwell.backend import dr

# After so many refusals a function is traced for good.
MOST_REFUSALS = 3


class Recorded:
    """A function of scene and arrays, recorded at its first call.

    Recording is refused while materials of another scene are alive in the process and have nested ones (masks, blends):
    virtual calls could reach them, and they are not among the arguments.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function, self.frozen = function, dr.freeze(function)
        self.refusals = 0

    def __call__(self, *arguments: Any) -> Any:
        if self.refusals < MOST_REFUSALS:
            try:
                return self.frozen(*arguments)
            except RuntimeError as error:
                if "frozen function" not in str(error):
                    raise
                self.refusals += 1
        return self.function(*arguments)
