"""How large the square of a light map is: a pilot asks whether its texels are too coarse for the light.

Notation: N points, n texels along an edge, halves a and b are independent.
"""

from __future__ import annotations

import numpy as np

from lightwell.bake.lightmap_trace import Sides, albedo, clear_glass
from lightwell.report.tonemap import display
from lightwell.scenes.atlas import NOWHERE, Atlas, build
from lightwell.scenes.scene import Scene
from lightwell.transport.irradiance import irradiance
from lightwell.transport.mapped import mapped_query
from lightwell.transport.surface import draw_surface
from lightwell.transport.texels import Texels, texels

# An atlas that is covered less than this becomes twice as large, up to a size.
ROOMY, MOST_ROOMY = 0.65, 2048
# So does one whose texels, read bilinearly, are this far from the light between them: mean squared error of a screen.
COARSE = 2e-4
# Points and paths of the pilot.
PILOT_POINTS, PILOT_PATHS = 1 << 15, 32


def roomy_atlas(scene: Scene, size: int, mips: int, sides: Sides, seed: int = 0) -> Atlas:
    """The atlas, twice as large where padding would take much of it or its texels are too coarse for the light."""
    made = build(scene, size, sides.lit, mips, dark=sides.dark, faint=sides.faint)
    if 2 * size > MOST_ROOMY or (made.coverage >= ROOMY and blur(scene, made, seed) < COARSE):
        return made
    return build(scene, 2 * size, sides.lit, mips, dark=sides.dark, faint=sides.faint)


def blur(scene: Scene, atlas: Atlas, seed: int, count: int = PILOT_POINTS, paths: int = PILOT_PATHS) -> float:
    """Mean squared error that a screen shows of bilinear reads of E' at places that see air, without noise.

    E' is traced at the places and at the texels around them alone; with two halves of each, A and B of what is read, a
    and b at the places, (A - a)(B - b) has the mean of the squared error.
    """
    points = draw_surface(scene, count, seed + 0xB10, floor=0).points
    query = mapped_query(scene, atlas, points)
    covered = texels(scene, atlas)
    texel, weight = _around(covered, atlas.size, query.uv1)
    kept = (weight.sum(axis=1) > 0) & (query.uv1 != NOWHERE).any(axis=1) & ~clear_glass(scene)[points.shape]
    if not kept.any():
        return 0.0
    points, shown, texel, weight = points[kept], albedo(query)[kept], texel[kept], weight[kept]
    used, place = np.unique(texel, return_inverse=True)
    there = irradiance(scene, covered.points[used], paths, seed + 0xB11)
    here = irradiance(scene, points, paths, seed + 0xB12)
    weight = (weight / weight.sum(axis=1, keepdims=True))[..., None]
    unit = 4 * max(float((shown * here.mean).mean()), 1e-12)
    error = 1.0
    for half, exact in ((there.half_a, here.half_a), (there.half_b, here.half_b)):
        read = (weight * half[place.reshape(texel.shape)]).sum(axis=1)
        error = error * (display(shown * read / unit) - display(shown * exact / unit))
    return float(np.nan_to_num(error).mean())


def _around(covered: Texels, n: int, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[N, 4] rows of the covered texels that a bilinear read at uv [N, 2] mixes, and their weights: 0 of others."""
    row = np.full(n * n, -1, np.int64)
    row[covered.index] = np.arange(len(covered.index))
    at = np.clip(uv.astype(np.float64) * n - 0.5, 0, n - 1)
    low = at.astype(np.int64)
    high, (x, y) = np.minimum(low + 1, n - 1), (at - low).T
    found = np.stack([row[b * n + a] for b in (low[:, 1], high[:, 1]) for a in (low[:, 0], high[:, 0])], axis=1)
    weight = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], axis=1)
    return np.maximum(found, 0), np.where(found >= 0, weight, 0)
