"""Progress bars of the verb ``lens``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Advance = Callable[[int], None]
"""Called with the number of steps done since the last call."""


@contextmanager
def bars(quiet: bool) -> Iterator[Callable[[str, int], Advance] | None]:
    """Provide progress bars on standard error.

    Args:
        quiet: Show no bars.

    Yields:
        A function ``bar(title, total)`` that opens a bar and returns its ``advance(n)``; None where no bars are shown,
        because ``quiet`` is set or standard error is not a terminal.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = TextColumn("{task.description:<22}"), BarColumn(28), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:

        def bar(title: str, total: int) -> Advance:
            task = progress.add_task(title, total=total)
            return lambda n: progress.advance(task, n)

        yield bar
