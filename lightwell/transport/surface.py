"""Sampling of surface points: area-uniform over all sides that border on air, with a least number per object.

Scenes with a dome of sky or ground of kilometres have a core, to which points can be confined (``pieces``).

Notation: N points asked for, C candidates, M meshes, T triangles.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from lightwell.core.sobol import Sobol
from lightwell.scenes.scene import Scene
from lightwell.transport.interactions import interaction as interaction
from lightwell.transport.pieces import Pieces, of_core, whole
from lightwell.transport.point_rejection import Rejection as Rejection
from lightwell.transport.point_rejection import reject as reject
from lightwell.transport.queries import dot, frames
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.tables import tables

# Least number of points of every visible object in a training set (specification 2.2).
FLOOR = 512
# Largest share of the points that floors may take.
FLOOR_SHARE = 0.25
# Largest number of candidates of one round; rounds after which the sampler stops with an error.
ROUND, ROUNDS = 1 << 17, 64
# Candidates without a single accepted point after which a surface counts as invisible.
HOPELESS = 1 << 12
# Rounds that fill up floors; the candidates of an object are this many times the number that its acceptance rate asks
# for, and the rate counts as at least LEAST_RATE.
FLOOR_ROUNDS, SPARE, LEAST_RATE = 4, 1.25, 1 / 64
# Of the views of glossy materials, this share is distributed by projected area (cosine), the rest uniformly.
PROJECTED_SHARE = 0.5


@dataclass(frozen=True)
class SurfaceDraw:
    """Sampled points, with weights and areas."""

    points: SurfacePoints
    weight: np.ndarray
    """[N] 1 / (density relative to area-uniform sampling of the visible sides)."""
    visible_area: np.ndarray
    """[M] estimated area of the sides that border on air, m² (a sheet seen from both sides counts twice)."""
    rejection: Rejection = field(default_factory=Rejection)


def sample_surface(
    scene: Scene,
    count: int,
    seed: int,
    *,
    floor: int = FLOOR,
    is_open: bool | None = None,
    report: Rejection | None = None,
) -> SurfacePoints:
    """Draw surface points without their weights, as ``draw_surface`` does.

    Args:
        scene: Scene to sample.
        count: Number of points, ≥ 1.
        seed: Seed of the points.
        floor: Points per visible object at least.
        is_open: Outdoor scene; None: measured.
        report: Receives the counts of dropped candidates, by reason.

    Returns:
        ``count`` points.
    """
    return draw_surface(scene, count, seed, floor=floor, is_open=is_open, report=report).points


def draw_surface(
    scene: Scene,
    count: int,
    seed: int,
    *,
    floor: int = FLOOR,
    is_open: bool | None = None,
    report: Rejection | None = None,
    only: np.ndarray | None = None,
    core: bool = False,
    shown: bool = False,
) -> SurfaceDraw:
    """Draw points, area-uniform over all sides that border on air; the same seed gives the same points.

    Args:
        scene: Scene with M meshes.
        count: Number of points, ≥ 1.
        seed: Seed of the points.
        floor: Points per visible object at least (as far as they fit in a quarter of the count); weights compensate.
        is_open: Outdoor scene; None: measured (``lightwell.transport.point_rejection.room``).
        report: Receives the counts of dropped candidates, by reason.
        only: [M] bool: meshes to draw from; None: all.
        core: Draw from the core of the scene alone, without its dome of sky and far ground.
        shown: Without the backs of one-sided materials, which reflect light but are never drawn.

    Returns:
        ``count`` points with weights, in random order.
    """
    report = Rejection() if report is None else report
    pieces = of_core(scene) if core else whole(scene)
    area = pieces.mesh_area
    source = _Candidates(scene, seed, is_open, report, only, pieces, shown)
    points = source.take(count)
    _, found = np.unique(points.shape, return_counts=True)
    floor = min(floor, int(FLOOR_SHARE * count / max(len(found), 1)))
    points = _with_floor(points, source, floor)
    visible = 2 * area * source.accepted / np.maximum(source.tried, 1)
    share = visible / visible.sum()
    taken = np.bincount(points.shape, minlength=len(area))
    weight = (share * count / np.maximum(taken, 1))[points.shape]
    order = np.random.default_rng([seed, 1]).permutation(len(points))
    return SurfaceDraw(points[order], weight[order].astype(np.float32), visible, report)


def _culled(scene: Scene, points: SurfacePoints) -> np.ndarray:
    """[N] bool: viewed from the back of a one-sided material."""
    return tables(scene).culled[points.shape] & (dot(frames(scene, points)[2], points.view)[:, 0] < 0)


def _with_floor(points: SurfacePoints, source: _Candidates, floor: int) -> SurfacePoints:
    """Replace points of well-sampled objects by points of those that have fewer than ``floor``."""
    have = np.bincount(points.shape, minlength=len(source.tried))
    extra = source.take_each(np.maximum(floor - have, 0))
    if not len(extra):
        return points
    rich = np.flatnonzero(have[points.shape] > floor)
    odds = _donor_odds(points.shape[rich], have[points.shape[rich]] - floor)
    rng = np.random.default_rng([source.seed, 2])
    removed = rng.choice(rich, size=min(len(extra), np.count_nonzero(odds)), replace=False, p=odds)
    return _join([points[np.setdiff1d(np.arange(len(points)), removed)], extra[np.arange(len(removed))]])


def _donor_odds(shape: np.ndarray, spare: np.ndarray) -> np.ndarray:
    """Compute the odds of being replaced: in proportion to the points that an object has above the floor."""
    odds = spare / np.bincount(shape)[shape]
    return odds / odds.sum()


def _join(parts: list[SurfacePoints]) -> SurfacePoints:
    fields = ("shape", "triangle", "barycentric", "view")
    return SurfacePoints(**{f: np.concatenate([getattr(p, f) for p in parts]) for f in fields})


class _Candidates:
    """A seeded stream of accepted points on chosen meshes."""

    def __init__(
        self, scene: Scene, seed: int, is_open: bool | None, report: Rejection, only: np.ndarray | None, pieces: Pieces,
        shown: bool,
    ) -> None:  # fmt: skip
        meshes, area = len(scene.meshes), pieces.mesh_area
        self.pieces, self.shown = pieces, shown
        self.area = area if only is None else np.where(only, area, 0)
        self.scene, self.seed, self.is_open, self.report = scene, seed, is_open, report
        self.accepted, self.tried = np.zeros((2, meshes), np.int64)
        self._calls = 0  # Requests so far: each has random numbers of its own

    def take(self, count: int) -> SurfacePoints:
        """Draw ``count`` accepted points, area-uniform over all chosen meshes."""
        numbers = self._numbers()
        parts, have, tried = [], 0, 0
        for _ in range(ROUNDS):
            rate = max(have, 1) / max(tried, 2)
            parts.append(self._round(numbers, (count - have) / rate, self.area))
            have, tried = have + len(parts[-1]), int(self.tried.sum())
            if have >= count:
                return _join(parts)[np.arange(count)]
            if not have and tried >= HOPELESS:
                if not self.shown:
                    break
                # A scene that is seen from behind alone: better its backs than nothing.
                self.shown = False
        raise ValueError(
            f"transport: scene '{self.scene.name}' has no surface that sees air ({self.report}); "
            "turn its normals to the air, move its cameras out of the walls or pass is_open=True"
        )

    def take_each(self, need: np.ndarray) -> SurfacePoints:
        """Draw ``need`` [M] accepted points of each object, fewer of objects where few candidates are accepted."""
        need = np.where(self.area > 0, need, 0)
        numbers, parts = self._numbers(), [_nothing()]
        for _ in range(FLOOR_ROUNDS):
            if not need.any():
                break
            rate = np.maximum(self.accepted, 1) / np.maximum(self.tried, 2)
            mass = need / np.maximum(rate, LEAST_RATE)
            found = self._round(numbers, SPARE * mass.sum(), mass)
            kept = found[_first_of_each(found.shape, need)]
            need = need - np.bincount(kept.shape, minlength=len(need))
            parts.append(kept)
        return _join(parts)

    def _numbers(self):
        """Make a scrambled Sobol sequence, another one for every request."""
        self._calls += 1
        return Sobol(7, np.random.default_rng([self.seed, 0, self._calls]))

    def _round(self, numbers, size: float, mass: np.ndarray) -> SurfacePoints:
        """Draw about ``size`` candidates; returns the accepted ones."""
        size = 1 << (int(np.clip(size, 256, ROUND)) - 1).bit_length()
        points = candidates(self.scene, numbers.random(size), self.pieces, mass)
        keep = reject(self.scene, points, is_open=self.is_open, seed=self.seed, report=self.report)
        keep &= ~(self.shown & _culled(self.scene, points))
        self.tried += np.bincount(points.shape, minlength=len(mass))
        self.accepted += np.bincount(points.shape[keep], minlength=len(mass))
        return points[keep]


def _first_of_each(shape: np.ndarray, need: np.ndarray) -> np.ndarray:
    """Find the rows of the first ``need`` points of each object."""
    order = np.argsort(shape, kind="stable")
    rank = np.arange(len(shape)) - np.searchsorted(shape[order], shape[order])
    return np.sort(order[rank < need[shape[order]]])


def _nothing() -> SurfacePoints:
    none = np.zeros(0, np.uint32)
    return SurfacePoints(none, none, np.zeros((0, 2), np.float32), np.zeros((0, 3), np.float32))


def candidates(scene: Scene, u: np.ndarray, pieces: Pieces, mass: np.ndarray | None = None) -> SurfacePoints:
    """Place points on random sides of triangles; none is rejected yet.

    Args:
        scene: Scene with M meshes.
        u: [C, 7] uniform numbers in [0, 1).
        pieces: The part of the surface to draw from.
        mass: [M] share of each object, within which points are area-uniform; None: its area.

    Returns:
        C points with random views.
    """
    t = tables(scene)
    per_area = np.ones(len(pieces.mesh_area)) if mass is None else mass / np.maximum(pieces.mesh_area, 1e-300)
    cdf = np.cumsum(pieces.area * per_area[t.mesh_of[pieces.triangle]])
    # Rounding of the sums must not select a piece after the last one with a share.
    piece = np.searchsorted(cdf, np.minimum(u[:, 0] * cdf[-1], np.nextafter(cdf[-1], 0)), side="right")
    triangle = pieces.triangle[piece]
    shape, root = t.mesh_of[triangle], np.sqrt(u[:, 1])
    weights = np.stack([1 - root, root * (1 - u[:, 2]), root * u[:, 2]], axis=-1)
    points = SurfacePoints(
        shape=shape.astype(np.uint32),
        triangle=(triangle - t.first[shape]).astype(np.uint32),
        barycentric=np.einsum("pc,pcw->pw", weights, pieces.corners[piece]).astype(np.float32),
        view=np.zeros((len(u), 3), np.float32),
    )
    side = np.where(u[:, 3:4] < 0.5, 1.0, -1.0)
    projected = t.glossy[shape] & (u[:, 6] < PROJECTED_SHARE)
    return replace(points, view=_views(scene, points, side, u[:, 4:6], projected))


def _views(scene: Scene, points: SurfacePoints, side: np.ndarray, u: np.ndarray, projected: np.ndarray) -> np.ndarray:
    """Draw unit directions over the hemisphere of the interpolated normal, on the given side of the triangle."""
    _, smooth, flat = frames(scene, points)
    flat = flat * side
    normal = np.where(dot(smooth, flat) < 0, -smooth, smooth)
    z = np.where(projected, np.sqrt(1 - u[:, 0]), 1 - u[:, 0])[:, None]
    radius, angle = np.sqrt(np.maximum(1 - z * z, 0)), 2 * np.pi * u[:, 1:2]
    tangent, bitangent = _tangents(normal)
    view = radius * (np.cos(angle) * tangent + np.sin(angle) * bitangent) + z * normal
    # Directions below the triangle's plane are mirrored above it.
    depth = dot(view, flat)
    view = np.where(depth < 0, view - 2 * depth * flat, view)
    return (view / np.linalg.norm(view, axis=-1, keepdims=True)).astype(np.float32)


def _tangents(n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute two unit vectors orthogonal to unit normals and to each other (Duff et al. 2017)."""
    sign = np.copysign(1.0, n[:, 2])
    a = -1 / (sign + n[:, 2])
    b = n[:, 0] * n[:, 1] * a
    first = np.stack([1 + sign * n[:, 0] ** 2 * a, sign * b, -sign * n[:, 0]], axis=-1)
    return first, np.stack([b, sign + n[:, 1] ** 2 * a, -n[:, 1]], axis=-1)
