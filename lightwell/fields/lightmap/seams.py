"""Training across seams: points that lie on two charts and must have the same colour on both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.fields.lightmap.sides import matte
from lightwell.fields.lightmap.trace import AtlasIrradiance
from lightwell.fields.lightmap.views import ViewSamples, corrected, joined
from lightwell.scenes.atlas_seams import Seams, seams
from lightwell.scenes.scene import Scene
from lightwell.transport.lightmap_query import query_of_lightmap
from lightwell.transport.queries import frames
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.tables import tables

# Share of the training samples that lie on seams.
SHARE = 0.1
# Points keep this part of the height of their triangle away from the edge: a point on it may belong to either.
INSIDE = 1e-3


@dataclass(frozen=True)
class SeamPairs:
    """N points on seams, once on each of their two charts, with the same view direction."""

    one: SurfacePoints
    two: SurfacePoints


def seam_pairs(scene: Scene, made: AtlasIrradiance, count: int, seed: int) -> SeamPairs | None:
    """Sample points on seams of glossy surfaces, uniformly along their length.

    Args:
        scene: The scene.
        made: Atlas and irradiance.
        count: Number of points.
        seed: Seed of the sampler.

    Returns:
        The points; None where no such seam exists.
    """
    found = seams(scene, made.atlas)
    mesh = tables(scene).mesh_of[found.triangle[:, 0]] if len(found) else np.zeros(0, int)
    odds = np.where(found.smooth & ~matte(scene)[mesh], found.length, 0) if len(found) else np.zeros(0)
    if not odds.sum() > 0:
        return None
    rng = np.random.default_rng([seed, 0x5EA])
    rows = rng.choice(len(odds), size=count, p=odds / odds.sum())
    t = rng.random(count).astype(np.float32)
    points = [_points(scene, found, rows, which, t) for which in (0, 1)]
    view = _views(scene, points[0], found.side[rows], rng)
    return SeamPairs(*(SurfacePoints(p.shape, p.triangle, p.barycentric, view) for p in points))


def _points(scene: Scene, found: Seams, rows: np.ndarray, which: int, t: np.ndarray) -> SurfacePoints:
    table = tables(scene)
    triangle = found.triangle[rows, which]
    shape = table.mesh_of[triangle]
    place = found.barycentric(rows, which, t)
    place = place * np.float32(1 - INSIDE) + np.float32(INSIDE / 3)
    local = (triangle - table.first[shape]).astype(np.uint32)
    return SurfacePoints(shape.astype(np.uint32), local, place, np.zeros((len(rows), 3), np.float32))


def _views(scene: Scene, points: SurfacePoints, side: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Cosine-distributed directions on the side that is stored."""
    flat = frames(scene, points)[2] * np.where(side == 0, 1, -1)[:, None]
    d = rng.normal(size=(len(points), 3))
    view = flat + 0.999 * d / np.linalg.norm(d, axis=1, keepdims=True)
    return (view / np.linalg.norm(view, axis=1, keepdims=True)).astype(np.float32)


def seam_samples(
    scene: Scene, made: AtlasIrradiance, known: np.ndarray, count: int, paths: int, seed: int
) -> ViewSamples | None:
    """Sample points on seams with one target for both charts: |f₁ − y|² + |f₂ − y|² bounds |f₁ − f₂|² / 2.

    Args:
        scene: The scene.
        made: Atlas and irradiance.
        known: [n, n, 3] irradiance / π of the atlas, at which paths end.
        count: Number of samples, two per point.
        paths: Paths per point, even, ≥ 2.
        seed: Seed of the sampler.

    Returns:
        The samples; None where no such seam exists.
    """
    pairs = seam_pairs(scene, made, max(count // 2, 1), seed)
    if pairs is None:
        return None
    a, b = corrected(scene, made.atlas, pairs.one, known, paths, seed)
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    queries = [query_of_lightmap(scene, made.atlas, points) for points in (pairs.one, pairs.two)]
    twice = lambda v: np.concatenate([v, v])  # noqa: E731
    return ViewSamples(joined(queries), *(twice(np.nan_to_num(v)) for v in (a, b)), twice(good.astype(np.float32)))
