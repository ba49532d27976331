"""Training across seams: places that lie on two charts, and must look alike on both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.fields.lightmap.trace import Chart, EyeSamples, corrected, matte
from lightwell.scenes.atlas_seams import Seams, seams
from lightwell.scenes.scene import Scene
from lightwell.transport.mapped import MappedQuery, mapped_query
from lightwell.transport.queries import frames
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.tables import tables

# Share of the training samples that lie on seams.
SHARE = 0.1
# Points keep this part of the height of their triangle away from the edge: a point on it may belong to either.
INSIDE = 1e-3


@dataclass(frozen=True)
class SeamPairs:
    """N places, once on each of their two charts, seen from the same direction."""

    one: SurfacePoints
    two: SurfacePoints


def seam_pairs(scene: Scene, made: Chart, count: int, seed: int) -> SeamPairs | None:
    """Places on seams of surfaces that the eye matters to, as dense along all; None without such seams."""
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


def seam_samples(scene: Scene, made: Chart, known: np.ndarray, count: int, paths: int, seed: int) -> EyeSamples | None:
    """Both charts' rows of ``count / 2`` places with one target: |f₁ − y|² + |f₂ − y|² bounds |f₁ − f₂|² / 2."""
    pairs = seam_pairs(scene, made, max(count // 2, 1), seed)
    if pairs is None:
        return None
    a, b = corrected(scene, made.atlas, pairs.one, known, paths, seed)
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    queries = [mapped_query(scene, made.atlas, points) for points in (pairs.one, pairs.two)]
    query = MappedQuery(
        **{n: np.concatenate([getattr(q, n) for q in queries]) for n in MappedQuery.__dataclass_fields__}
    )
    twice = lambda v: np.concatenate([v, v])  # noqa: E731
    return EyeSamples(query, *(twice(np.nan_to_num(v)) for v in (a, b)), twice(good.astype(np.float32)))


def seam_gap(scene: Scene, made: Chart, field, unit: float, seed: int, count: int = 1 << 13) -> float:
    """Mean |L₁ − L₂| over the mean of both, across seams where light is continuous; 0 without such seams."""
    pairs = seam_pairs(scene, made, count, seed)
    if pairs is None:
        return 0.0
    one, two = (field(mapped_query(scene, made.atlas, points)) / unit for points in (pairs.one, pairs.two))
    return float(np.abs(one - two).mean() / max(0.5 * (one + two).mean(), 1e-9))
