"""The error that loading a scene raises."""

from __future__ import annotations


class SceneError(ValueError):
    """A scene that cannot be used. One line: the file, the element, what was expected and the cure."""
