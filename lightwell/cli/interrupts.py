"""Detect Ctrl-C even where native code replaces ``KeyboardInterrupt`` by another error."""

from __future__ import annotations

import signal
import threading
from types import FrameType


class Interrupts:
    """Records that Ctrl-C was pressed; use as a context manager around a command.

    Native code that calls back into Python may turn ``KeyboardInterrupt`` into an error of its own; ``received`` then
    says that the error is an interrupt. A second Ctrl-C after the context has ended stops the process at once.
    """

    received = False

    def __enter__(self) -> Interrupts:
        self._ours = threading.current_thread() is threading.main_thread()
        if self._ours:
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        if self._ours:
            # The process is about to end; a second Ctrl-C during its clean-up must not print a traceback.
            signal.signal(signal.SIGINT, signal.SIG_DFL if self.received else self._before)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.received = True
        raise KeyboardInterrupt
