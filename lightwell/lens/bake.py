"""Baking: from the kernel of a node to its representations.

Every node gets the cheapest representation whose error is small ("main") and, where that one is sparse, a lossless
one ("fine") for pixels so bright that the sparse error would be seen.
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
# Light outside the support and relative L2 that a sparse spreadlet may have, and how its point count grows until then.
LEAK, ERROR, GROWTH, TRIES = 0.02, 0.13, 1.12, 12
# A set of points that is exact may cost this much more than a sparse one.
EXACT_BONUS = 1.3
# An exact set of so few points is always taken; of so few where the radius is below the recipe's smallest.
EXACT, EXACT_SMALL = 40, 100
# Distances of the two rings of a disc from its rim that are tried, pixels.
APART = (0.7, 0.85, 1.0, 1.25, 1.5)


def exact(kernel: np.ndarray) -> Spreadlet:
    """Primal or lossless, whichever writes less; a primal kernel needs no solve."""
    f = charges(kernel)
    if np.count_nonzero(kernel) <= int((np.abs(f) > DUST * np.abs(f).max()).sum()):
        return primal(kernel)
    return lossless(kernel)


def bake_node(family: Family, index: int, recipe: Recipe) -> list[tuple[int, Spreadlet]]:
    """(tier, spreadlet) of a node: one that is exact, or a sparse one and, where it is shorter than dense, a fine one.

    A node without a fine tier whose main one is sparse takes its dense kernel instead, which needs no file.
    """
    kernel = family.kernel(index)
    radius, second, _ = family.node(index)
    length = second if family.name != "cats-eye" else 0.0
    # Turned between pixels, the points of a bare Laplacian ring; light itself only blurs by a fraction of a pixel.
    best = primal(kernel) if family.turns else exact(kernel)
    if len(best) <= EXACT or (radius < recipe.smallest and len(best) <= EXACT_SMALL):
        return [(MAIN, best)]
    fine = [(FINE, best)] if best.kind == CHARGE else []
    if recipe.name == "paper":
        from lightwell.lens.paper import paper

        return [(MAIN, paper(kernel, recipe, index)), *fine]
    count = min(recipe.count(radius, length), max(int(recipe.share * np.count_nonzero(kernel)), EXACT))
    plain = family.aperture.round and length == 0 and family.name != "cats-eye"
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
    """{(node, tier): spreadlet} of the nodes asked for; ``advance`` is called with the number of nodes done."""
    nodes = sorted(set(int(n) for n in nodes))
    made: dict[tuple[int, int], Spreadlet] = {}
    for index in nodes:
        for tier, spreadlet in bake_node(family, index, recipe):
            made[index, tier] = spreadlet
        advance(1)
    return made
