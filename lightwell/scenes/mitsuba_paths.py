"""Folders whose files a Mitsuba scene may name: its own folder, and those that the user allows."""

from __future__ import annotations

import os
import stat
from collections.abc import Sequence
from pathlib import Path

from lightwell.scenes.errors import SceneError


class Folders:
    """Finds the files that a scene names."""

    def __init__(self, folder: Path, allowed: Sequence[str | os.PathLike[str]] = ()) -> None:
        """Set the folders.

        Args:
            folder: Folder of the scene's file.
            allowed: Further folders whose files may be named (``--allow-path``).

        Raises:
            SceneError: An allowed folder does not exist.
        """
        self._own = _real(folder)
        self._allowed = [_real(Path(path)) for path in allowed]
        for path, real in zip(allowed, self._allowed, strict=True):
            if not real.is_dir():
                raise SceneError(f"--allow-path: '{os.fspath(path)}' is no folder; name one that exists")
        self._searched = [self._own]

    def add(self, name: str, place: str) -> None:
        """Search one more folder.

        Args:
            name: Name of the folder in the scene.
            place: Beginning of messages.

        Raises:
            SceneError: It is no folder, or may not be read.
        """
        real = self._inside(self._own / name, name, place)
        if not real.is_dir():
            raise SceneError(f"{place}: '{name}' is no folder; correct the <path>")
        self._searched.append(real)

    def find(self, name: str, place: str, first: Path | None = None) -> Path | None:
        """Find a file.

        Args:
            name: Name in the scene: relative to its folder, or absolute and inside an allowed folder.
            place: Beginning of messages.
            first: A folder to search before all others.

        Returns:
            Its path with links resolved, or None where there is no such file.

        Raises:
            SceneError: The name is empty, or the file is in no allowed folder or is no regular file.
        """
        if not name or "\0" in name:
            raise SceneError(f"{place}: has an empty file name; name a file")
        spellings = [name, name.replace("\\", "/")] if "\\" in name else [name]
        for spelling in spellings:
            for folder in [*([first] if first else []), *self._searched, *self._allowed]:
                real = self._inside(folder / spelling, name, place)
                if os.path.lexists(real):
                    return _regular(real, name, place)
        return None

    def _inside(self, path: Path, name: str, place: str) -> Path:
        """Resolve links of ``path``, if it may be read."""
        roots = self._allowed if Path(name).is_absolute() else [self._own, *self._allowed]
        real = _real(path)
        if not any(real.is_relative_to(root) for root in roots):
            raise SceneError(
                f"{place}: the file '{_short(name)}' is not inside the scene's folder; move it there and name it "
                f"relative to the scene, or allow its folder with --allow-path {_short(str(real.parent))}"
            )
        return real


def _real(path: Path) -> Path:
    try:
        return Path(os.path.realpath(path))
    except (OSError, ValueError):
        raise SceneError(f"scene: '{_short(str(path))}' is no path; correct it") from None


def _regular(path: Path, name: str, place: str) -> Path:
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise SceneError(f"{place}: '{_short(name)}' cannot be opened ({error.strerror}); correct the name") from None
    if not stat.S_ISREG(mode):
        raise SceneError(f"{place}: '{_short(name)}' is no regular file; name a file")
    return path


def _short(text: str) -> str:
    return text if len(text) <= 120 else f"{text[:60]}…{text[-50:]}"
