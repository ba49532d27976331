"""Refuse to write over a file that the same command reads."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from lightwell.lens.errors import LensError


def check_inputs_are_kept(
    command: str, written: Iterable[tuple[str, str | Path]], read: Iterable[tuple[str, str | Path]]
) -> None:
    """Refuse outputs that are the same file as an input, before any work begins.

    Files are compared, not names: a link and another spelling of a path are the same file.

    Args:
        command: Name of the command, for the message.
        written: Option and path of each file to write; a file need not exist.
        read: Option and path of each file that is read.

    Raises:
        LensError: A file would be written over an input; one line.
    """
    outputs = {found: entry for entry in written if (found := _file(entry[1])) is not None}
    if not outputs:
        return
    for name, path in read:
        found = _file(path)
        if found in outputs:
            option, target = outputs[found]
            same = "" if str(target) == str(path) else f" ('{path}')"
            raise LensError(
                f"{command}: {option} '{target}' is the file of {name}{same}, which would be lost; give another file "
                "to write"
            )


def _file(path: str | Path) -> tuple[int, int] | None:
    """Device and number of a file, which are the same for all its names; None: there is none."""
    try:
        state = os.stat(path)
    except (OSError, ValueError):
        return None
    return state.st_dev, state.st_ino
