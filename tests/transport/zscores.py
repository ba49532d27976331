"""Statistics of the transport tests: means with standard errors, and z-tests corrected for their number (Šidák 1967).

Notation: N points, G groups. A group is a mean over many paths, so that its distribution is near enough to normal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from lightwell.backend import dr, mi
from lightwell.transport.interactions import interaction
from lightwell.transport.radiance import indirect
from lightwell.transport.samples import SurfacePoints

# Chance that a correct estimator fails a test; seeds are fixed, so that a pass stays a pass.
SIGNIFICANCE = 0.01
# Groups of an estimate; its standard error has one degree of freedom less (Student's t).
GROUPS = 64


@dataclass(frozen=True)
class Estimate:
    """A Monte Carlo mean."""

    mean: np.ndarray
    """[N, 3]."""
    variance: np.ndarray
    """[N, 3] squared standard error of the mean."""

    def __sub__(self, other: Estimate) -> Estimate:
        return Estimate(self.mean - other.mean, self.variance + other.variance)

    def __add__(self, other: Estimate) -> Estimate:
        return Estimate(self.mean + other.mean, self.variance + other.variance)

    def __mul__(self, factor) -> Estimate:
        return Estimate(self.mean * factor, self.variance * np.square(factor))


def of_groups(groups: np.ndarray) -> Estimate:
    """The estimate of [N, G, 3] group means."""
    return Estimate(groups.mean(axis=1), groups.var(axis=1, ddof=1) / groups.shape[1])


def ours(scene, points, light, variable, paths: int, seed: int, groups: int = GROUPS, **options) -> Estimate:
    """``indirect`` with ``paths`` paths per point, in groups."""
    light = np.broadcast_to(np.asarray(light, np.float32), (len(points), 3))
    rows = np.repeat(np.arange(len(points)), groups // 2)
    a, b = indirect(scene, points[rows], light[rows], variable, paths * 2 // groups, seed, **options)
    return of_groups(np.stack([a, b], axis=1).reshape(len(points), groups, 3))


def mitsubas(scene, points, emitters: dict, integrator: dict, paths: int, seed: int, groups: int = GROUPS) -> Estimate:
    """What a Mitsuba integrator sees when it looks at the points from their views, lit by ``emitters`` alone."""
    shapes = {f"shape_{i}": s for i, s in enumerate(scene.mi.shapes())}
    lit = mi.load_dict({"type": "scene", **shapes, **emitters}, optimize=False)
    rows = np.repeat(np.arange(len(points)), paths)
    si = interaction(scene, points[rows])
    view = si.to_world(si.wi)
    # A ray that starts just above the point and looks at it.
    ray = mi.Ray3f(si.p + 1e-3 * view, -view)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, len(rows))
    L, _, _ = mi.load_dict(integrator).sample(lit, sampler, mi.RayDifferential3f(ray))
    L = dr.block_sum(L, paths // groups) / (paths // groups)
    return of_groups(np.array(L).T.reshape(len(points), groups, 3).astype(np.float64))


def z_test(difference: Estimate, significance: float = SIGNIFICANCE) -> tuple[bool, str]:
    """Whether a difference is nothing but noise, in every point and on the whole; and the figures.

    Two tests at half the significance each: the largest |z| against the Šidák bound of N tests, and the mean of all z,
    which sees a small error that all points share. z is taken of the mean of the three channels, whose standard error
    is at most the mean of theirs (the test is then conservative).
    """
    error = np.sqrt(difference.variance).mean(axis=1)
    value = difference.mean.mean(axis=1)
    z = value[error > 0] / error[error > 0]
    single = 1 - (1 - significance / 2) ** (1 / len(z))
    largest, bound = np.abs(z).max(), stats.t.isf(single / 2, GROUPS - 1)
    shared, shared_bound = abs(z.mean()) * np.sqrt(len(z)), stats.norm.isf(significance / 4)
    # Where neither estimate varies they must agree: light that no path finds.
    exact = bool(np.allclose(value[error == 0], 0, atol=1e-6))
    text = f"max |z| {largest:.2f} (bound {bound:.2f}), shared {shared:.2f} (bound {shared_bound:.2f}), exact {exact}"
    return bool(largest < bound and shared < shared_bound and exact), text


def with_view(points: SurfacePoints, view: np.ndarray) -> SurfacePoints:
    """The same points seen from elsewhere."""
    return replace(points, view=np.asarray(view, np.float32))
