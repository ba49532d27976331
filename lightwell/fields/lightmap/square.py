"""The size of the square atlas of a light map."""

from __future__ import annotations

from lightwell.fields.lightmap.sides import TriangleSides
from lightwell.scenes.atlas import Atlas, build
from lightwell.scenes.scene import Scene

# An atlas that is covered less than this becomes twice as large, up to a size.
ROOMY, MOST_ROOMY = 0.65, 2048


def roomy_atlas(scene: Scene, size: int, mips: int, sides: TriangleSides) -> Atlas:
    """Make an atlas, twice as large where the charts are so small that padding would take much of it.

    Args:
        scene: The scene.
        size: Texels along the edge.
        mips: Levels of the mip chain.
        sides: Sides to store.

    Returns:
        The atlas.
    """
    made = build(scene, size, sides.lit, mips, dark=sides.dark, faint=sides.faint)
    if made.coverage >= ROOMY or 2 * size > MOST_ROOMY:
        return made
    return build(scene, 2 * size, sides.lit, mips, dark=sides.dark, faint=sides.faint)
