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
    sparse: float = 0.5
    """Share of covered texels of the larger one below which charts mix at mip 1, which saves half of their padding."""
    usable: float = 0.3
    """Share of covered texels below which the smaller one is no choice, however few the paths."""


@dataclass(frozen=True)
class AtlasChoice:
    """An atlas, and the one that serves where its texels would get too few paths."""

    first: Atlas
    smaller: Atlas | None = None


def atlas_of(scene: Scene, size: int, mips: int, sides: TriangleSides, own: bool = True) -> Atlas:
    """Make the atlas of the sides that are stored.

    Args:
        scene: The scene.
        size: Texels along the edge.
        mips: Levels of the mip chain.
        sides: Sides to store.
        own: Use the author's second texture coordinates where they are valid.

    Returns:
        The atlas.

    Raises:
        ValueError: The charts do not fit.
    """
    return build(scene, size, sides.lit, mips, sides.density, own, sides.dark, sides.faint)


def roomy_atlas(
    scene: Scene, size: int, mips: int, sides: TriangleSides, limits: AtlasLimits | None = None, fixed: bool = False
) -> AtlasChoice:
    """Make an atlas, twice as large where the charts are so small that padding would take much of it.

    Args:
        scene: The scene.
        size: Texels along the edge.
        mips: Levels of the mip chain.
        sides: Sides to store.
        limits: When it becomes larger; None: the defaults.
        fixed: The levels of the mip chain must be ``mips``.

    Returns:
        The atlas.

    Raises:
        ValueError: The charts fit into none.
    """
    limits = limits or AtlasLimits()
    if 2 * size > limits.largest:
        return AtlasChoice(atlas_of(scene, size, mips, sides))
    small = _try(scene, size, mips, sides)
    if isinstance(small, Atlas) and small.coverage >= limits.least_coverage:
        return AtlasChoice(small)
    large = _try(scene, 2 * size, mips, sides)
    if mips and not fixed and not (isinstance(large, Atlas) and large.coverage >= limits.sparse):
        large = _try(scene, 2 * size, 0, sides)
    if isinstance(large, ValueError):
        raise large
    return AtlasChoice(large, small if isinstance(small, Atlas) and small.coverage >= limits.usable else None)


def _try(scene: Scene, size: int, mips: int, sides: TriangleSides) -> Atlas | ValueError:
    """The atlas, or why its charts do not fit."""
    try:
        return atlas_of(scene, size, mips, sides)
    except ValueError as error:
        return error
