"""Failures of the scoring after tracing and training become notes of the report, so that the bake is not lost."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from lightwell.core.progress import Progress

T = TypeVar("T")
LONGEST_NOTE = 200


class LateNotes:
    """Collects one line for each part of the scoring that failed."""

    texts: list[str]
    """The notes so far."""

    def __init__(self, progress: Progress) -> None:
        """Start without notes.

        Args:
            progress: Prints each note at once.
        """
        self.texts = []
        self._progress = progress

    def attempt(self, what: str, make: Callable[[], T], otherwise: T) -> T:
        """Compute a part of the scoring, or add a note that it failed.

        Args:
            what: Name of the part in the note.
            make: Computes the part.
            otherwise: Result after a failure.

        Returns:
            The result of ``make``, or ``otherwise``.

        Raises:
            OSError: A file cannot be read or written; the work is kept for ``--resume``.
        """
        try:
            return make()
        except Exception as error:  # any failure here is worth less than the bake
            # Encoders of pictures raise this too, without the number of a system's error.
            if isinstance(error, OSError) and error.errno is not None:
                raise
            reason = " ".join(str(error).split())[:LONGEST_NOTE] or type(error).__name__
            self.add(f"{what} could not be made and is left out of the report ({reason})")
            return otherwise

    def add(self, text: str) -> None:
        """Add a note.

        Args:
            text: One line.
        """
        self.texts.append(text)
        self._progress.say(f"[yellow]note[/] {text}")
