"""Options of surface fields of one network. The command line is made from this module, so it imports nothing slow."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lightwell.core.options import option


@dataclass(frozen=True)
class SurfaceOptions:
    """Options of ``--field factored`` and ``--field mlp``."""

    rebake: Path | None = option(
        None,
        "an edit of the bake in OLD (made with --keep): what has changed is found; only what could notice it is traced "
        "again, and training goes on from the weights of OLD; nothing is scored",
        parse=Path,
        metavar="OLD",
    )
