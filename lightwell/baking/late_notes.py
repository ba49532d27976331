"""What comes after tracing and training must not cost the user the bake: its failures become notes of the report."""

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
            progress: Where each note is also said at once.
        """
        self.texts = []
        self._progress = progress

    def attempt(self, what: str, make: Callable[[], T], otherwise: T) -> T:
        """Make something, or note that it failed.

        Args:
            what: Name of the part, as the note calls it.
            make: Makes it.
            otherwise: What stands in its place after a failure.

        Returns:
            What ``make`` returned, or ``otherwise``.

        Raises:
            OSError: A file cannot be read or written: the work is kept, and ``--resume`` goes on.
        """
        try:
            return make()
        except OSError:
            raise
        except Exception as error:  # any failure here is worth less than the bake
            reason = " ".join(str(error).split())[:LONGEST_NOTE] or type(error).__name__
            self.add(f"{what} could not be made and is left out of the report ({reason})")
            return otherwise

    def add(self, text: str) -> None:
        """Take a note.

        Args:
            text: One line.
        """
        self.texts.append(text)
        self._progress.say(f"[yellow]note[/] {text}")
