"""The command ``lightwell``, and ``python -m lightwell``."""

import signal
import sys

# Ctrl-C while modules are imported ends the process without a traceback; the command line then handles it.
signal.signal(signal.SIGINT, signal.SIG_DFL)

from lightwell.cli import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
