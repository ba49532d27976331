"""Irradiance at surface points: what a light map stores.

E' = (1 / π) ∫ L(ω) max(n · ω, 0) dω = irradiance / π, so that a Lambertian surface has radiance albedo · E'.
Notation: N points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.executor import Arrays, Recipe
from lightwell.scenes.scene import Scene
from lightwell.transport.interactions import DevicePoints, gather_interaction
from lightwell.transport.panes import unblocked
from lightwell.transport.path_numbers import LATTICE_STREAM, check_halves, independent, random_streams, stratified
from lightwell.transport.path_state import interaction_at, power_heuristic
from lightwell.transport.paths import MAX_DEPTH, RR_DEPTH, trace
from lightwell.transport.point_rejection import WRONG_SHARE, air_sides, right_side
from lightwell.transport.radiance import LAUNCH
from lightwell.transport.row_tasks import rows_of
from lightwell.transport.samples import SurfacePoints, columns_of
from lightwell.transport.sources import Emitters
from lightwell.transport.tables import tables


@dataclass(frozen=True)
class Irradiance:
    """Irradiance / π at N points on the side of their views."""

    half_a: np.ndarray
    """[N, 3] E' by the first half of the paths."""
    half_b: np.ndarray
    """[N, 3] E' by the second, independent half."""
    direction: np.ndarray
    """[N, 3] mean of luminance times direction, over pi: its length over the luminance of E' is at most 1."""
    wrong: np.ndarray
    """[N] share of cosine-distributed rays that first meet a side that cannot border on air."""

    @property
    def mean(self) -> np.ndarray:
        """[N, 3] mean of both halves."""
        return 0.5 * (self.half_a + self.half_b)

    @property
    def valid(self) -> np.ndarray:
        """[N] bool: at most a quarter of the hemisphere shows sides that cannot border on air."""
        return self.wrong <= WRONG_SHARE


def irradiance(scene: Scene, points: SurfacePoints, paths: int, seed: int, recipe: Recipe | None = None) -> Irradiance:
    """Estimate irradiance / π from the scene's own emitters, direct and indirect, by path tracing.

    Args:
        scene: Scene to trace.
        points: N points.
        paths: Paths per point, even, ≥ 2.
        seed: Seed of the paths.
        recipe: How workers make the points again; None: they are sent.

    Returns:
        Two independent half means, the mean direction, and the share of rays that meet insides.

    Raises:
        ValueError: ``paths`` is odd or below 2.
    """
    check_halves(paths)
    settings = {"paths": paths, "seed": seed}
    rows = rows_of(scene, "irradiance", settings, columns_of(points), paths, recipe=recipe)["rows"]
    both = rows.mean(axis=1)
    return Irradiance(rows[:, 0, :3], rows[:, 1, :3], both[:, 3:6], both[:, 6])


def irradiance_rows(scene: Scene, settings: Mapping[str, Any], columns: Arrays, first: int, shared: Arrays) -> Arrays:
    """Trace rows of ``irradiance``; see ``row_tasks.RowFunction``.

    Args:
        scene: Scene to trace.
        settings: ``paths`` and ``seed``.
        columns: Columns of ``SurfacePoints``, [N, ...] each.
        first: Number of the first row.
        shared: Not used.

    Returns:
        ``rows`` [N, 2, 7]: by half E', luminance times direction, share of wrong first hits.
    """
    sides = air_sides(scene)
    estimate = lambda *at: _arriving(scene, sides, *at)  # noqa: E731
    return {"rows": half_means(scene, settings, columns, first, estimate, 7)}


def half_means(
    scene: Scene,
    settings: Mapping[str, Any],
    columns: Arrays,
    first: int,
    estimate: Callable[..., tuple[Any, ...]],
    width: int,
) -> np.ndarray:
    """Estimate the light that arrives at points, by two independent halves of the paths.

    Args:
        scene: Scene to trace.
        settings: ``paths`` and ``seed``.
        columns: Columns of ``SurfacePoints``, [N, ...] each.
        first: Number of the first row.
        estimate: Makes one estimate per lane from surface interactions, views, random numbers, points in [0, 1)² of the
            first direction, longest path and depth of the roulette: E', luminance times direction, further columns.
        width: C, columns of an estimate.

    Returns:
        [N, 2, C] float32 means; estimates that are not finite count as 0.
    """
    tables(scene)
    points = SurfacePoints(*(columns[name] for name in ("shape", "triangle", "barycentric", "view")))
    device, half = DevicePoints(points), settings["paths"] // 2
    batch = max(1, LAUNCH // settings["paths"])
    numbers = (settings["seed"] & 0xFFFFFFFF, MAX_DEPTH, RR_DEPTH, half, first)
    opaque = [dr.opaque(mi.UInt32, v) for v in numbers]
    rows = np.zeros((len(points), 2, width), np.float32)
    for start in range(0, len(points), batch):
        count = min(batch, len(points) - start)
        rows[start : start + count] = _launch(scene, device, opaque, start, count, half, estimate) / half
    return rows


def _launch(scene: Scene, device, settings, start: int, count: int, half: int, estimate) -> np.ndarray:
    """Trace one launch; returns [count, 2, C] sums by half."""
    seed, max_depth, rr_depth, size, first = settings
    lane = dr.arange(mi.UInt32, count * 2 * half)
    group, path = lane // size, lane % size
    row = dr.opaque(mi.UInt32, start) + group // 2
    rng = random_streams(seed, first + row, (group & 1) * size + path)
    shift = random_streams(seed, first + row, LATTICE_STREAM + (group & 1))
    si = gather_interaction(scene, device, row)
    view = dr.gather(mi.Vector3f, device.view, row)
    L, direction, *more = estimate(si, view, rng, stratified(shift, path, size)[1], max_depth, rr_depth)
    ok = dr.all(dr.isfinite(L)) & dr.all(dr.isfinite(direction))
    columns = [*dr.select(ok, L, 0), *dr.select(ok, direction, 0), *more]
    dr.eval(columns)
    sums = [np.array(dr.block_sum(column, half)) for column in columns]
    return np.stack(sums, axis=1).reshape(count, 2, -1)


def _arriving(scene: Scene, sides, si, view, rng, u, max_depth, rr_depth):
    """Estimate E' once at ``si`` on the side of ``view``: emitter sampling and a cosine-distributed ray."""
    source, geometry = Emitters.of(scene), scene.mi
    direct, wo, d, density, above = first_directions(geometry, si, view, source, rng, u)
    ray = si.spawn_ray(d)
    pi = geometry.ray_intersect_preliminary(ray, active=above)
    wrong = pi.is_valid() & ~right_side(scene, sides, pi, ray)
    met = pi.compute_surface_interaction(ray, mi.RayFlags.All, above)
    Le, hit_pdf = source.hit(geometry, interaction_at(si), met, ray, mi.Bool(False), above)
    L = dr.select(above, power_heuristic(density, hit_pdf) * Le, 0)
    L += dr.select(
        above & met.is_valid(),
        trace(geometry, met, source, rng, independent(rng), max_depth - 1, rr_depth, True),
        0,
    )
    direction = wo * mi.luminance(direct) + d * mi.luminance(L)
    return direct + L, direction, dr.select(wrong, mi.Float(1), 0)


def first_directions(geometry, si, view, source, rng, u):
    """Sample the light at points where E' is estimated, and a cosine-distributed direction.

    Args:
        geometry: Mitsuba scene.
        si: [N] surface interactions.
        view: [N] directions on the side on which light arrives.
        source: What shines.
        rng: Random numbers, one stream per lane.
        u: [N] random points in [0, 1)² of the cosine-distributed directions.

    Returns:
        [N] each: E' by the sampled light, with its weight against the other direction; the direction towards the light;
        the cosine-distributed direction, its density per steradian, and whether it is above the surface.
    """
    # ----------------- Normals on the requested side ------------------
    flat = mi.Vector3f(si.n) * dr.sign(dr.dot(si.n, view))
    normal = mi.Vector3f(si.sh_frame.n)
    normal *= dr.select(dr.dot(normal, flat) < 0, -1.0, 1.0)
    # ------------------------ Emitter sampling ------------------------
    light = mi.Point2f(rng.next_float32(), rng.next_float32())
    wo, weight, pdf, delta, shadow = source.sample(geometry, si, light, mi.Bool(True))
    cosine = dr.dot(normal, wo)
    lit = (dr.max(weight) > 0) & (cosine > 0) & (dr.dot(flat, wo) > 0)
    T, _ = unblocked(geometry, source.panes, shadow, lit, delta)
    mis = dr.select(delta, 1, power_heuristic(pdf, cosine * dr.inv_pi))
    direct = dr.select(lit, T * mis * weight * cosine * dr.inv_pi, 0)
    # ------------------ Cosine-distributed direction ------------------
    d = mi.Frame3f(normal).to_world(mi.warp.square_to_cosine_hemisphere(u))
    return direct, wo, d, dr.dot(normal, d) * dr.inv_pi, dr.dot(flat, d) > 0
