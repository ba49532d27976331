"""The one error that loading a scene raises."""

from __future__ import annotations


class SceneError(ValueError):
    """A scene that cannot be used. One line: the file, the thing, what was expected and the cure."""
