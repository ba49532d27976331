"""Handle Ctrl-C once, and without a traceback, also where native code replaces ``KeyboardInterrupt`` or drops it."""

from __future__ import annotations

import os
import signal
import sys
import threading
from types import FrameType

# Exit code of a process that Ctrl-C ended, as shells expect.
INTERRUPTED = 130


class Interrupts:
    """Records that Ctrl-C was pressed; use as a context manager around a command, inside the ``try``.

    The first Ctrl-C raises ``KeyboardInterrupt``. A second one ends the process at once with exit code 130: no
    traceback from clean-up, and a way out where the first was dropped. Native code that calls back into Python may turn
    ``KeyboardInterrupt`` into an error of its own; ``received`` then says that the error is an interrupt.
    """

    received = False

    def __enter__(self) -> Interrupts:
        self._ours = threading.current_thread() is threading.main_thread()
        if self._ours:
            self._hook = sys.unraisablehook
            sys.unraisablehook = self._end_where_dropped
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        if self._ours:
            sys.unraisablehook = self._hook
            # The process is about to end; a second Ctrl-C during its clean-up must not print a traceback.
            signal.signal(signal.SIGINT, _end if self.received else self._before)

    def _note(self, number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, _end)
        self.received = True
        raise KeyboardInterrupt

    def _end_where_dropped(self, unraisable: sys.UnraisableHookArgs) -> None:
        """End the process after an interrupt in a destructor or callback: Python would print it and go on."""
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            os._exit(INTERRUPTED)
        self._hook(unraisable)


def _end(number: int, frame: FrameType | None) -> None:
    """End the process at once."""
    os._exit(INTERRUPTED)
