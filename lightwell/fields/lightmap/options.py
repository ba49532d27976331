"""Options of light maps."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lightwell.core.options import option
from lightwell.core.units import byte_count

# Longest edge of a light map: that of a texture in the format.
MOST_TEXELS = 4096


def _power_of_two(size: int) -> str:
    good = size <= MOST_TEXELS and not size & (size - 1)
    return "" if good else f"is not a power of two up to {MOST_TEXELS}; give 512 or 1024"


@dataclass(frozen=True)
class LightmapOptions:
    """Options of ``--field lightmap``."""

    size: int | None = option(
        None,
        "texels along each edge of the atlas (default: 1024, or 2048 where charts are small)",
        least=16,
        check=_power_of_two,
    )
    mips: int = option(1, "mip level up to which charts do not mix (default: 1)", least=0)
    rebake: Path | None = option(
        None,
        "an edit of the bake in OLD (made with --keep): only texels that could notice a change are traced again",
        parse=Path,
        metavar="OLD",
    )
    max_bytes: int | None = option(
        None,
        "the best that fits, 1MB or 250kB, by short trial fits",
        parse=byte_count,
        metavar="SIZE",
        least=1,
    )
