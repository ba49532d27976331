"""One bake of the command line."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from lightwell.baking.settings import BakeSettings

if TYPE_CHECKING:
    from lightwell.baking.preview import Preview


def run_bake(arguments: argparse.Namespace, asked: BakeSettings, preview: Preview | None = None) -> int:
    """Bake; print the report as JSON if requested.

    Args:
        arguments: Parsed arguments.
        asked: Settings of the bake.
        preview: Shows what is learned; None: nothing is shown.

    Returns:
        Exit code.
    """
    from lightwell.baking.pipeline import bake
    from lightwell.core.progress import Progress

    report = bake(asked, Progress(quiet=arguments.json), started=arguments.started, preview=preview)
    if arguments.json:
        print(json.dumps(report, indent=1))
    return 0
