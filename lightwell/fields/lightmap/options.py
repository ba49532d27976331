"""Options of light maps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from lightwell.core.options import option
from lightwell.core.units import byte_count

if TYPE_CHECKING:
    from lightwell.fields.lightmap.fit import LightmapPreset

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
    mips: int | None = option(
        None, "mip level up to which charts do not mix (default: 1, or 0 where charts are many and small)", least=0
    )
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
    compress: str | None = option(
        None,
        "pictures that stay compressed on the GPU, a quarter of its memory or less: ktx2 (UASTC, which browsers make "
        "BC7 or ASTC of), or ktx2-etc1s (the ordinary light map as ETC1S: half of that, with more error)",
        choices=("ktx2", "ktx2-etc1s"),
    )


def stored_as(preset: LightmapPreset, compress: str | None) -> LightmapPreset:
    """Choose the codecs of the option ``--compress``.

    Args:
        preset: The preset.
        compress: "ktx2", "ktx2-etc1s", or None for those of the preset.

    Returns:
        The preset with these codecs.
    """
    if compress is None:
        return preset
    base = "etc1s" if compress == "ktx2-etc1s" else "uastc"
    return replace(preset, codec="uastc", base=base if preset.base else "")
