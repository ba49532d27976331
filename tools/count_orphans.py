"""Runs a command and waits for the processes that it leaves behind, so that their processor time counts as its own.

    python tools/count_orphans.py COMMAND ...

A browser that is told to end leaves its processes to the system, and with them the time of everything that they drew.
On Linux this process adopts them; elsewhere the command runs as it would without. The exit code is that of the command.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import time

# Of prctl(2): orphans among the descendants become children of this process.
PR_SET_CHILD_SUBREAPER = 36
# Longest wait for what is left when the command has ended, seconds.
PATIENCE = 5.0
POLL = 0.02


def reap(main: int) -> int:
    """Wait for a process and, for a while, for the orphans that it leaves.

    Args:
        main: Number of the process, a child of this one.

    Returns:
        Its exit code; 128 + the signal where a signal ended it.
    """
    code, deadline = 0, float("inf")
    with contextlib.suppress(ChildProcessError):
        while time.monotonic() < deadline:
            found, status = os.waitpid(-1, 0 if deadline == float("inf") else os.WNOHANG)
            if found == main:
                code, deadline = os.waitstatus_to_exitcode(status), time.monotonic() + PATIENCE
            elif not found:
                time.sleep(POLL)
    return code if code >= 0 else 128 - code


def main() -> int:
    """Run the words of the command line.

    Returns:
        Exit code.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    process = subprocess.Popen(sys.argv[1:])
    signal.signal(signal.SIGTERM, lambda *_: process.terminate())
    return reap(process.pid)


if __name__ == "__main__":
    sys.exit(main())
