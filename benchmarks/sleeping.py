"""A task that sleeps in place of tracing, for workers that are started with ``--preload sleeping``."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from lightwell.scenes.executor import Arrays
from lightwell.scenes.scene import Scene
from lightwell.transport.row_tasks import TASKS, RowTask


def sleeping_rows(scene: Scene, settings: Mapping[str, Any], columns: Arrays, first: int, shared: Arrays) -> Arrays:
    """Sleep for the time of a kernel; the rows come back as they are."""
    time.sleep(settings["seconds"])
    return {"row": columns["row"]}


TASKS["sleep"] = RowTask("sleeping:sleeping_rows")
