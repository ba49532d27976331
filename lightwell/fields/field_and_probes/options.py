"""Options of ``--field factored+probes``. The command line is made from this module, so it imports nothing slow."""

from __future__ import annotations

from dataclasses import dataclass

from lightwell.core.options import option
from lightwell.core.units import metres


@dataclass(frozen=True)
class FieldAndProbesOptions:
    """Options of ``--field factored+probes``."""

    spacing: float | None = option(
        None,
        "distance of neighbouring probes, 1m or 50cm (default: as of probes alone, or wider by the time)",
        parse=metres,
        metavar="LENGTH",
        check=lambda v: "" if 0 < v < float("inf") else "is not a length; give metres, such as 1m",
    )
