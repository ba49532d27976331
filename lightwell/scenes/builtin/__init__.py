"""The built-in scenes: made by code, in metres, the same bytes every time.

``cornell`` is the textbook box, ``courtyard`` a house around a light well, ``two-rooms`` a test for light that leaks
through thin walls. None holds a light: the roaming light of the bake brings it.
"""

from __future__ import annotations

from ..scene import Scene
from . import cornell, courtyard, two_rooms

_BUILDERS = {"cornell": cornell.build, "courtyard": courtyard.build, "two-rooms": two_rooms.build}

NAMES = tuple(_BUILDERS)


def build(name: str) -> Scene:
    """Build the built-in scene ``name``, one of ``NAMES``."""
    if name not in _BUILDERS:
        raise ValueError(f"scene: there is no built-in scene '{name}'; choose one of {', '.join(NAMES)}")
    return _BUILDERS[name]()


__all__ = ["NAMES", "build"]
