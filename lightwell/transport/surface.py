"""Where samples are taken: area-uniform over all sides of surfaces that see air, with a floor per object.

Notation: N points asked for, C candidates, M meshes, T triangles.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from lightwell.scenes.scene import Scene
from lightwell.transport.air import Rejection as Rejection
from lightwell.transport.air import reject as reject
from lightwell.transport.interactions import interaction as interaction
from lightwell.transport.queries import dot, frames
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.tables import tables

# Points that every visible object gets at least (specification 2.2), of a whole training set.
FLOOR = 512
# Largest share of the points that floors may take.
FLOOR_SHARE = 0.25
# Candidates of one round are at most this many; rounds before the sampler gives up.
ROUND, ROUNDS = 1 << 17, 64
# Candidates without a single accepted point after which a surface counts as invisible.
HOPELESS = 1 << 12
# Rounds that fill up floors; an object is given this many times the candidates that it seems to need, and candidates
# for an acceptance of at least LEAST_RATE.
FLOOR_ROUNDS, SPARE, LEAST_RATE = 4, 1.25, 1 / 64
# Of the views of glossy materials, this share is distributed by projected area (cosine), the rest uniformly.
PROJECTED_SHARE = 0.5


@dataclass(frozen=True)
class SurfaceDraw:
    """Sampled points and what is needed to interpret them."""

    points: SurfacePoints
    weight: np.ndarray
    """[N] 1 / (density relative to area-uniform sampling of the visible sides)."""
    visible_area: np.ndarray
    """[M] estimated area of the sides that see air, square metres (a sheet seen from both sides counts twice)."""
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
    """``draw_surface`` for those who need only the points; ``report`` receives the counts of the rejection."""
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
) -> SurfaceDraw:
    """``count`` points, area-uniform over all sides that see air; the same seed gives the same points.

    only      [M] bool: meshes that are drawn from; None: all.
    floor     Points per visible object at least (as far as they fit in a quarter of the count); weights undo it.
    is_open   Outdoor scene; None: measured (``lightwell.transport.air.room``).
    """
    report = Rejection() if report is None else report
    area = tables(scene).mesh_area
    source = _Candidates(scene, seed, is_open, report, only)
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
    """Odds of being replaced: an object gives in proportion to what it has above the floor."""
    odds = spare / np.bincount(shape)[shape]
    return odds / odds.sum()


def _join(parts: list[SurfacePoints]) -> SurfacePoints:
    fields = ("shape", "triangle", "barycentric", "view")
    return SurfacePoints(**{f: np.concatenate([getattr(p, f) for p in parts]) for f in fields})


class _Candidates:
    """An endless, seeded supply of accepted points on chosen meshes."""

    def __init__(self, scene: Scene, seed: int, is_open: bool | None, report: Rejection, only: np.ndarray | None):
        meshes, area = len(scene.meshes), tables(scene).mesh_area
        self.area = area if only is None else np.where(only, area, 0)
        self.scene, self.seed, self.is_open, self.report = scene, seed, is_open, report
        self.accepted, self.tried = np.zeros((2, meshes), np.int64)
        self._calls = 0  # gives every request numbers of its own

    def take(self, count: int) -> SurfacePoints:
        """``count`` accepted points, area-uniform over everything."""
        numbers = self._numbers()
        parts, have, tried = [], 0, 0
        for _ in range(ROUNDS):
            rate = max(have, 1) / max(tried, 2)
            parts.append(self._round(numbers, (count - have) / rate, self.area))
            have, tried = have + len(parts[-1]), int(self.tried.sum())
            if have >= count:
                return _join(parts)[np.arange(count)]
            if not have and tried >= HOPELESS:
                break
        raise ValueError(
            f"transport: scene '{self.scene.name}' has no surface that sees air ({self.report}); "
            "turn its normals to the air, move its cameras out of the walls or pass is_open=True"
        )

    def take_each(self, need: np.ndarray) -> SurfacePoints:
        """``need`` [M] accepted points of each object, fewer of objects that hardly see air."""
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
        """A scrambled Sobol sequence of its own for every request."""
        from scipy.stats import qmc

        self._calls += 1
        return qmc.Sobol(7, scramble=True, rng=np.random.default_rng([self.seed, 0, self._calls]))

    def _round(self, numbers, size: float, mass: np.ndarray) -> SurfacePoints:
        """Accepted ones of about ``size`` candidates."""
        size = 1 << (int(np.clip(size, 256, ROUND)) - 1).bit_length()
        points = candidates(self.scene, numbers.random(size), mass)
        keep = reject(self.scene, points, is_open=self.is_open, seed=self.seed, report=self.report)
        self.tried += np.bincount(points.shape, minlength=len(mass))
        self.accepted += np.bincount(points.shape[keep], minlength=len(mass))
        return points[keep]


def _first_of_each(shape: np.ndarray, need: np.ndarray) -> np.ndarray:
    """Rows of the first ``need`` points of each object."""
    order = np.argsort(shape, kind="stable")
    rank = np.arange(len(shape)) - np.searchsorted(shape[order], shape[order])
    return np.sort(order[rank < need[shape[order]]])


def _nothing() -> SurfacePoints:
    none = np.zeros(0, np.uint32)
    return SurfacePoints(none, none, np.zeros((0, 2), np.float32), np.zeros((0, 3), np.float32))


def candidates(scene: Scene, u: np.ndarray, mass: np.ndarray | None = None) -> SurfacePoints:
    """Points on random sides from uniform numbers [C, 7]; nothing rejected yet.

    mass   [M] share of each object, within which points are area-uniform; None: its area.
    """
    t = tables(scene)
    per_area = np.ones(len(t.mesh_area)) if mass is None else mass / np.maximum(t.mesh_area, 1e-300)
    cdf = np.cumsum(t.area * per_area[t.mesh_of])
    # Not beyond the last triangle that has any share, however the sums round.
    triangle = np.searchsorted(cdf, np.minimum(u[:, 0] * cdf[-1], np.nextafter(cdf[-1], 0)), side="right")
    shape = t.mesh_of[triangle]
    root = np.sqrt(u[:, 1])
    points = SurfacePoints(
        shape=shape.astype(np.uint32),
        triangle=(triangle - t.first[shape]).astype(np.uint32),
        barycentric=np.stack([root * (1 - u[:, 2]), root * u[:, 2]], axis=-1).astype(np.float32),
        view=np.zeros((len(u), 3), np.float32),
    )
    side = np.where(u[:, 3:4] < 0.5, 1.0, -1.0)
    projected = t.glossy[shape] & (u[:, 6] < PROJECTED_SHARE)
    return replace(points, view=_views(scene, points, side, u[:, 4:6], projected))


def _views(scene: Scene, points: SurfacePoints, side: np.ndarray, u: np.ndarray, projected: np.ndarray) -> np.ndarray:
    """Unit directions over the hemisphere of the interpolated normal, on the given side of the triangle."""
    _, smooth, flat = frames(scene, points)
    flat = flat * side
    normal = np.where(dot(smooth, flat) < 0, -smooth, smooth)
    z = np.where(projected, np.sqrt(1 - u[:, 0]), 1 - u[:, 0])[:, None]
    radius, angle = np.sqrt(np.maximum(1 - z * z, 0)), 2 * np.pi * u[:, 1:2]
    tangent, bitangent = _tangents(normal)
    view = radius * (np.cos(angle) * tangent + np.sin(angle) * bitangent) + z * normal
    # Beneath the triangle's own plane: mirrored back above it.
    depth = dot(view, flat)
    view = np.where(depth < 0, view - 2 * depth * flat, view)
    return (view / np.linalg.norm(view, axis=-1, keepdims=True)).astype(np.float32)


def _tangents(n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors at right angles to unit normals and to each other (Duff et al. 2017)."""
    sign = np.copysign(1.0, n[:, 2])
    a = -1 / (sign + n[:, 2])
    b = n[:, 0] * n[:, 1] * a
    first = np.stack([1 + sign * n[:, 0] ** 2 * a, sign * b, -sign * n[:, 0]], axis=-1)
    return first, np.stack([b, sign + n[:, 1] ** 2 * a, -n[:, 1]], axis=-1)
