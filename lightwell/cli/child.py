"""A command in a process of its own, which ends when the process that started it ends, also when that was killed.

python -m lightwell.cli.child bake room.glb -o out
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
from collections.abc import Sequence

from lightwell.cli.interrupts import INTERRUPTED

# Seconds that an interrupted command has to write its checkpoint.
PATIENCE = 60.0


def run_child(words: Sequence[str]) -> int:
    """Run a command of lightwell in a process of its own.

    Args:
        words: Words after ``lightwell``.

    Returns:
        Its exit code; negative for a signal.

    Raises:
        KeyboardInterrupt: Ctrl-C; the command was given time to end in order.
    """
    argv = [sys.executable, "-m", "lightwell.cli.child", *words]
    with subprocess.Popen(argv, stdin=subprocess.PIPE) as process:
        try:
            return process.wait()
        except KeyboardInterrupt:
            # The terminal has interrupted the command as well.
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(PATIENCE)
            raise


def _end_with_parent() -> None:
    """End the process when its standard input ends, which the system closes when the parent process is gone."""
    with contextlib.suppress(OSError):
        os.read(0, 1)
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    from lightwell.cli import main

    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    sys.exit(main(sys.argv[1:]))
