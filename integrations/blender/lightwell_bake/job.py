"""A bake in a process of its own, asked now and then how far it is. Nothing here needs Blender."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

# Seconds after which a process that was asked to end is killed: a cancel is over within a second.
PATIENCE = 0.6
# Longest message and longest end of the log that are read, bytes.
MOST_TEXT = 4096


class Job:
    """A running command. ``poll`` and ``cancel`` return at once."""

    def __init__(self, command: Sequence[str], folder: Path, environment: Mapping[str, str] | None = None) -> None:
        """Start the command.

        Args:
            command: Its words.
            folder: Folder of its log and messages; it is made.
            environment: Variables of the process; None: those of this one.

        Raises:
            OSError: The program cannot be started.
        """
        folder.mkdir(parents=True, exist_ok=True)
        self.log, self._messages = folder / "progress.log", folder / "messages.txt"
        self.log.write_text("")
        self.started, self._asked = time.monotonic(), 0.0
        windows = sys.platform == "win32"
        group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP} if windows else {"start_new_session": True}
        with self._messages.open("wb") as messages:
            self._process = subprocess.Popen(
                list(command),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=messages,
                env=dict(environment) if environment is not None else None,
                **group,
            )

    @property
    def seconds(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self.started

    def poll(self) -> int | None:
        """Return the exit code, or None while the process runs. One that was cancelled is killed when it is late."""
        if self._asked and time.monotonic() - self._asked > PATIENCE and self._process.poll() is None:
            self._end(force=True)
        return self._process.poll()

    def cancel(self) -> None:
        """Ask the process to end; ``poll`` kills it when it does not."""
        if not self._asked and self._process.poll() is None:
            self._asked = time.monotonic()
            self._end(force=False)

    def wait(self) -> int:
        """Wait for the end: for Blender without a window.

        Returns:
            The exit code.
        """
        return self._process.wait()

    def _end(self, force: bool) -> None:
        try:
            if sys.platform == "win32":
                self._process.kill() if force else self._process.send_signal(signal.CTRL_BREAK_EVENT)
            else:
                # The whole group: a bake has workers.
                os.killpg(self._process.pid, signal.SIGKILL if force else signal.SIGTERM)
        except (ProcessLookupError, PermissionError):
            pass

    def stage(self) -> str:
        """Return what the bake does now: the last line of its log, without time and level."""
        lines = _end_of(self.log).splitlines()
        return lines[-1].split(maxsplit=3)[-1][:120] if lines else "starting"

    def message(self) -> str:
        """Return the last line that the process has written to standard error."""
        lines = [line for line in _end_of(self._messages).splitlines() if line.strip()]
        return lines[-1][:300] if lines else "lightwell ended without a message"


def _end_of(path: Path) -> str:
    with path.open("rb") as stream:
        stream.seek(0, os.SEEK_END)
        stream.seek(max(0, stream.tell() - MOST_TEXT))
        return stream.read().decode("utf-8", "replace")


def lost_in(report: Path) -> list[str]:
    """Read what a bake could not represent.

    Args:
        report: Its report.json.

    Returns:
        The warnings; empty where there is no report.
    """
    try:
        found = json.loads(report.read_text("utf-8")).get("warnings", [])
    except (OSError, ValueError):
        return []
    return [str(line) for line in found] if isinstance(found, list) else []
