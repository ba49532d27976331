"""Precompute spreadlets: from the kernel of a node to its representations.

Every node gets the representation with the fewest points whose error is small (tier ``MAIN``) and, where that one is
sparse, a lossless one (tier ``FINE``) for pixels so bright that the error of the sparse one would be visible.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from lightwell.lens.families import Family
from lightwell.lens.psf import charges
from lightwell.lens.recipes import DUST, Recipe, lossless, primal, rings, sparse
from lightwell.lens.spreadlet import CHARGE, Spreadlet

# Tiers of a node.
MAIN, FINE = 0, 1
# Limits of a sparse spreadlet: light outside the support and relative L2 error; growth of its point count per try.
LEAK, ERROR, GROWTH, TRIES = 0.02, 0.13, 1.12, 12
# An exact spreadlet is preferred up to this factor of a sparse one's points.
EXACT_BONUS = 1.3
# Points up to which an exact spreadlet is always used; the second number applies below the smallest sparse radius.
EXACT, EXACT_SMALL = 40, 100
# Candidate distances of the two rings of points from the rim of a disc, pixels.
APART = (0.7, 0.85, 1.0, 1.25, 1.5)


def exact(kernel: np.ndarray) -> Spreadlet:
    """Represent a kernel exactly, as primal or lossless points, whichever are fewer; primal points need no solve.

    Args:
        kernel: Point spread function [2·hy+1, 2·hx+1].

    Returns:
        The spreadlet.
    """
    f = charges(kernel)
    if np.count_nonzero(kernel) <= int((np.abs(f) > DUST * np.abs(f).max()).sum()):
        return primal(kernel)
    return lossless(kernel)


def bake_node(family: Family, index: int, recipe: Recipe) -> list[tuple[int, Spreadlet]]:
    """Make the spreadlets of one node: an exact one, or a sparse one and a lossless one for bright pixels.

    A node has no lossless tier where its dense kernel has fewer points; the dense kernel is then computed when needed
    and not stored.

    Args:
        family: Family of kernels.
        index: Node, 0 to ``family.size`` − 1.
        recipe: How spreadlets are made.

    Returns:
        (tier, spreadlet) of every tier.
    """
    kernel = family.kernel(index)
    radius, second, _ = family.node(index)
    length = 0.0 if family.by_field else second
    # Rotated to positions between pixels, lossless charges ring; primal points only blur by a fraction of a pixel.
    best = primal(kernel) if family.turns else exact(kernel)
    if len(best) <= EXACT or (radius < recipe.smallest and len(best) <= EXACT_SMALL):
        return [(MAIN, best)]
    fine = [(FINE, best)] if best.kind == CHARGE else []
    if recipe.name == "paper":
        from lightwell.lens.paper import paper

        return [(MAIN, paper(kernel, recipe, index)), *fine]
    count = min(recipe.count(radius, length), max(int(recipe.share * np.count_nonzero(kernel)), EXACT))
    plain = family.aperture.round and length == 0 and not family.by_field
    for _ in range(TRIES):
        if count * EXACT_BONUS >= len(best):
            return [(MAIN, best)]
        starts = tuple(rings(radius, count, apart) for apart in APART) if plain else ()
        made = sparse(kernel, count, recipe, index, starts)
        if made.score.leak <= LEAK and made.score.error <= ERROR:
            break
        count = int(np.ceil(count * GROWTH))
    else:
        return [(MAIN, best)]
    return [(MAIN, made), *fine]


def bake_nodes(
    family: Family, nodes: Iterable[int], recipe: Recipe, advance: Callable[[int], None] = lambda n: None
) -> dict[tuple[int, int], Spreadlet]:
    """Make the spreadlets of several nodes.

    Args:
        family: Family of kernels.
        nodes: Indices of the nodes; duplicates are ignored.
        recipe: How spreadlets are made.
        advance: Called with the number of nodes done since the last call.

    Returns:
        {(node, tier): spreadlet}.
    """
    nodes = sorted(set(int(n) for n in nodes))
    made: dict[tuple[int, int], Spreadlet] = {}
    for index in nodes:
        for tier, spreadlet in bake_node(family, index, recipe):
            made[index, tier] = spreadlet
        advance(1)
    return made
