"""The command ``lightwell``, and ``python -m lightwell``."""

# Only modules that every start of Python has loaded: importing another one takes milliseconds, in which Ctrl-C would
# still print a traceback.
import _signal
import os
import sys


def _end_quietly(number: int, frame: object) -> None:
    """End the process with the exit code that shells give to Ctrl-C."""
    os._exit(130)


# Until the command line handles Ctrl-C itself.
_signal.signal(_signal.SIGINT, _end_quietly)

from lightwell.cli import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
