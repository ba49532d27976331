"""``python -m lightwell.cli``."""

import sys

from lightwell.cli import main

if __name__ == "__main__":
    sys.exit(main())
