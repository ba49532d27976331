"""Progress of long work: one bar per stage with rate, current error and remaining time."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as RichProgress
from rich.text import Text

LOG = logging.getLogger("lightwell")


class ProgressStage:
    """One progress bar with a note behind it."""

    def __init__(self, bars: RichProgress | None, task: int) -> None:
        """Wrap a bar.

        Args:
            bars: Display that has the bar; None shows nothing.
            task: Identifier of the bar in the display.
        """
        self._bars, self._task = bars, task

    def advance(self, steps: float = 1, note: str | None = None) -> None:
        """Move the bar forward.

        Args:
            steps: Steps that were done since the last call.
            note: Text behind the bar; None keeps the present one.
        """
        if self._bars:
            extra = {} if note is None else {"note": note}
            self._bars.update(self._task, advance=steps, **extra)

    def move_to(self, completed: float, note: str | None = None) -> None:
        """Set the bar to a number of steps.

        Args:
            completed: Steps that were done since the start.
            note: Text behind the bar; None keeps the present one.
        """
        if self._bars:
            extra = {} if note is None else {"note": note}
            self._bars.update(self._task, completed=completed, **extra)


class Progress:
    """Progress bars on standard error."""

    def __init__(self, quiet: bool = False) -> None:
        """Create the display.

        Args:
            quiet: Show nothing.
        """
        self.quiet = quiet
        self._console = Console(stderr=True)

    @contextmanager
    def stage(self, title: str, total: float, note: str = "") -> Iterator[ProgressStage]:
        """Show a bar during a block.

        Args:
            title: Name of the stage.
            total: Number of its steps.
            note: Text behind the bar.

        Yields:
            The bar.
        """
        LOG.info("%s: %g steps %s", title, total, note)
        if self.quiet:
            yield ProgressStage(None, 0)
            return
        columns = (
            TextColumn("[bold]{task.description:<22}"),
            BarColumn(bar_width=28),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}"),
        )
        with RichProgress(*columns, console=self._console) as bars:
            yield ProgressStage(bars, bars.add_task(title, total=total, note=note))

    def say(self, text: str) -> None:
        """Print a line.

        Args:
            text: The line.
        """
        LOG.info("%s", Text.from_markup(text).plain)
        if not self.quiet:
            self._console.print(text, highlight=False, soft_wrap=True)
