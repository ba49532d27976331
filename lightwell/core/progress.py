"""Progress of long work: one bar per stage with rate, error so far and remaining time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as RichProgress


class Stage:
    """One bar. ``advance`` moves it and may change the text behind it."""

    def __init__(self, bars: RichProgress | None, task: int) -> None:
        self._bars, self._task = bars, task

    def advance(self, steps: float = 1, note: str | None = None) -> None:
        """Move forward by ``steps`` and show ``note``."""
        if self._bars:
            extra = {} if note is None else {"note": note}
            self._bars.update(self._task, advance=steps, **extra)

    def move_to(self, completed: float, note: str | None = None) -> None:
        """Show ``completed`` steps as done."""
        if self._bars:
            extra = {} if note is None else {"note": note}
            self._bars.update(self._task, completed=completed, **extra)


class Progress:
    """Bars on standard error, or nothing at all when ``quiet``."""

    def __init__(self, quiet: bool = False) -> None:
        self.quiet = quiet
        self._console = Console(stderr=True)

    @contextmanager
    def stage(self, title: str, total: float, note: str = "") -> Iterator[Stage]:
        """A bar that lives for the duration of a ``with`` block."""
        if self.quiet:
            yield Stage(None, 0)
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
            yield Stage(bars, bars.add_task(title, total=total, note=note))

    def say(self, text: str) -> None:
        """One line of news."""
        if not self.quiet:
            self._console.print(text, highlight=False, soft_wrap=True)
