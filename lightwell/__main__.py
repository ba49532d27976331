"""The command ``lightwell``, and ``python -m lightwell``."""

# The module signal takes milliseconds to import, in which Ctrl-C would still be a traceback.
import _signal
import sys

# Ctrl-C while modules are imported ends the process in silence; the command line then handles it.
_signal.signal(_signal.SIGINT, _signal.SIG_DFL)

from lightwell.cli import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
