"""The size of the square atlas of a light map."""

from __future__ import annotations

from dataclasses import dataclass

from lightwell.fields.lightmap.sides import TriangleSides
from lightwell.scenes.atlas import Atlas, build
from lightwell.scenes.scene import Scene


@dataclass(frozen=True)
class AtlasLimits:
    """When the atlas of a scene of small charts becomes twice as large."""

    least_coverage: float = 0.65
    """Share of covered texels below which it does, ..."""
    largest: int = 2048
    """... up to this edge, texels, ..."""
    fewest_paths: int = 32
    """... and unless its texels would get fewer paths than this: noise costs more than small texels gain."""


def roomy_atlas(scene: Scene, size: int, mips: int, sides: TriangleSides, limits: AtlasLimits | None = None) -> Atlas:
    """Make an atlas, twice as large where the charts are so small that padding would take much of it.

    Args:
        scene: The scene.
        size: Texels along the edge.
        mips: Levels of the mip chain.
        sides: Sides to store.
        limits: When it becomes larger; None: the defaults.

    Returns:
        The atlas.
    """
    limits = limits or AtlasLimits()
    made = build(scene, size, sides.lit, mips, dark=sides.dark, faint=sides.faint)
    if made.coverage >= limits.least_coverage or 2 * size > limits.largest:
        return made
    return build(scene, 2 * size, sides.lit, mips, dark=sides.dark, faint=sides.faint)
