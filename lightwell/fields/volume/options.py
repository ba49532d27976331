"""Options of ``--field volume``. The command line is made from this module, so it imports nothing slow."""

from __future__ import annotations

from dataclasses import dataclass

from lightwell.core.options import option
from lightwell.core.units import metres


@dataclass(frozen=True)
class VolumeOptions:
    """Options of ``--field volume``."""

    spacing: float | None = option(
        None,
        "distance of neighbouring nodes, 50cm or 1m (default: a sixteenth of the longest edge, less in flat scenes)",
        parse=metres,
        metavar="LENGTH",
        check=lambda v: "" if 0 < v < float("inf") else "is not a length; give metres, such as 1m",
    )
