"""Progress of long work: one bar per stage with rate, current error and remaining time."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as RichProgress
from rich.text import Text

LOG = logging.getLogger("lightwell")

# A bar in a notebook is drawn anew after so long.
REDRAW_SECONDS = 0.2


class ProgressStage:
    """One progress bar with a note behind it."""

    def __init__(self, bars: RichProgress | NotebookBar | None, task: TaskID) -> None:
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
            extra: dict[str, Any] = {} if note is None else {"note": note}
            self._bars.update(self._task, advance=steps, **extra)

    def move_to(self, completed: float, note: str | None = None) -> None:
        """Set the bar to a number of steps.

        Args:
            completed: Steps that were done since the start.
            note: Text behind the bar; None keeps the present one.
        """
        if self._bars:
            extra: dict[str, Any] = {} if note is None else {"note": note}
            self._bars.update(self._task, completed=completed, **extra)


class NotebookBar:
    """A progress bar in the output of a notebook cell; it needs no widgets."""

    def __init__(self, title: str, total: float, note: str = "") -> None:
        """Show an empty bar.

        Args:
            title: Name of the stage.
            total: Number of its steps.
            note: Text behind the bar.
        """
        from IPython.display import HTML, display

        show: Callable[..., Any] = display
        self._html: Callable[..., Any] = HTML
        self._begin, self._shown = perf_counter(), 0.0
        self._values: dict[str, Any] = {"title": title, "total": total, "done": 0.0, "note": note, "seconds": 0.0}
        self._handle = show(self._page(), display_id=True)

    def _page(self) -> Any:
        from lightwell.core.notebook import TEMPLATES

        return self._html(TEMPLATES.render("bar.html", **self._values))

    def update(
        self, task: TaskID, /, *, completed: float | None = None, advance: float | None = None, **fields: Any
    ) -> None:
        """Move the bar; it is drawn anew a few times a second.

        Args:
            task: Not used: there is one bar.
            completed: Steps that were done since the start; None: as ``advance`` says.
            advance: Steps that were done since the last call.
            **fields: ``note``, the text behind the bar.
        """
        done = self._values["done"] + (advance or 0) if completed is None else completed
        self._values |= {"done": done, **fields}
        now = perf_counter()
        if now - self._shown >= REDRAW_SECONDS or done >= self._values["total"]:
            self._shown = now
            self._values["seconds"] = now - self._begin
            self._handle.update(self._page())


class Progress:
    """Progress bars on standard error."""

    def __init__(self, quiet: bool = False, console: Console | None = None) -> None:
        """Create the display.

        Args:
            quiet: Show nothing.
            console: Where to print; None: standard error, or the output of the cell in a notebook.
        """
        self.quiet = quiet
        self._console = console or Console(stderr=True)

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
        LOG.info("%s: %g %s", title, total, note or "parts")
        if self.quiet:
            yield ProgressStage(None, TaskID(0))
            return
        if self._console.is_jupyter:
            yield ProgressStage(NotebookBar(title, total, note), TaskID(0))
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
