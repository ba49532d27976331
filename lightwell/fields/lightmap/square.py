"""The size of the square atlas of a light map."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from time import perf_counter

import numpy as np

from lightwell.core.formats import ARRAYS
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


class AtlasChoiceFormat:
    """File format of an ``AtlasChoice``: an .npz file."""

    suffix = ".npz"

    def write(self, path: Path, value: AtlasChoice) -> None:
        """Write both atlases.

        Args:
            path: File to create.
            value: The atlases.
        """
        made = {"first": value.first} | ({} if value.smaller is None else {"smaller": value.smaller})
        columns = [f.name for f in fields(Atlas)]
        ARRAYS.write(path, {f"{name}.{c}": np.asarray(getattr(a, c)) for name, a in made.items() for c in columns})

    def read(self, path: Path) -> AtlasChoice:
        """Read both atlases.

        Args:
            path: File that ``write`` created.

        Returns:
            The atlases.
        """
        found = ARRAYS.read(path)
        made = {}
        for name in {key.partition(".")[0] for key in found}:
            columns = {f.name: found[f"{name}.{f.name}"] for f in fields(Atlas)}
            plain = {key: value if value.ndim else value.item() for key, value in columns.items()}
            made[name] = Atlas(**plain)
        return AtlasChoice(made["first"], made.get("smaller"))


def atlas_of(
    scene: Scene, size: int, mips: int, sides: TriangleSides, own: bool = True, deadline: float = np.inf
) -> Atlas:
    """Make the atlas of the sides that are stored.

    Args:
        scene: The scene.
        size: Texels along the edge.
        mips: Levels of the mip chain.
        sides: Sides to store.
        own: Use the author's second texture coordinates where they are valid.
        deadline: ``perf_counter()`` at which the search for a better packing ends.

    Returns:
        The atlas.

    Raises:
        ValueError: The charts do not fit.
    """
    return build(scene, size, sides.lit, mips, sides.density, own, sides.dark, sides.faint, deadline)


def roomy_atlas(
    scene: Scene,
    size: int,
    mips: int,
    sides: TriangleSides,
    limits: AtlasLimits | None = None,
    fixed: bool = False,
    deadline: float = np.inf,
) -> AtlasChoice:
    """Make an atlas, twice as large where the charts are so small that padding would take much of it.

    Args:
        scene: The scene.
        size: Texels along the edge.
        mips: Levels of the mip chain.
        sides: Sides to store.
        limits: When it becomes larger; None: the defaults.
        fixed: The levels of the mip chain must be ``mips``.
        deadline: ``perf_counter()`` at which the search for better packings ends.

    Returns:
        The atlas.

    Raises:
        ValueError: The charts fit into none.
    """
    limits = limits or AtlasLimits()
    if 2 * size > limits.largest:
        return AtlasChoice(atlas_of(scene, size, mips, sides, deadline=deadline))
    # A third of the time for each packing: the last one is needed where the others are too sparse.
    start = perf_counter()
    ends = [start + k / 3 * (deadline - start) for k in (1, 2, 3)]
    small = _try(scene, size, mips, sides, ends[0])
    if isinstance(small, Atlas) and small.coverage >= limits.least_coverage:
        return AtlasChoice(small)
    large = _try(scene, 2 * size, mips, sides, ends[1])
    if mips and not fixed and not (isinstance(large, Atlas) and large.coverage >= limits.sparse):
        large = _try(scene, 2 * size, 0, sides, ends[2])
    if isinstance(large, ValueError):
        raise large
    return AtlasChoice(large, small if isinstance(small, Atlas) and small.coverage >= limits.usable else None)


def _try(scene: Scene, size: int, mips: int, sides: TriangleSides, deadline: float) -> Atlas | ValueError:
    """The atlas, or why its charts do not fit."""
    try:
        return atlas_of(scene, size, mips, sides, deadline=deadline)
    except ValueError as error:
        return error
