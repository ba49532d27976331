"""Path traces light in air: irradiance harmonics, and irradiance, at points that lie on no surface.

Notation: N points; one lane is one path; each point has two independent halves of the paths.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_integers
from lightwell.graph.ops.encoding import sh_components
from lightwell.probes.sh import TO_IRRADIANCE
from lightwell.scenes.executor import Arrays, Inputs, Recipe
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Turning, Variable, from_json, has_sky, to_json
from lightwell.transport.interactions import upload
from lightwell.transport.lamp_sources import GroupEmitters
from lightwell.transport.panes import unblocked
from lightwell.transport.path_numbers import LATTICE_STREAM, check_halves, independent, random_streams, stratified
from lightwell.transport.path_state import interaction_at, power_heuristic
from lightwell.transport.paths import MAX_DEPTH, RR_DEPTH, trace
from lightwell.transport.row_tasks import rows_of
from lightwell.transport.sources import Emitters, declared
from lightwell.transport.tables import tables

LAUNCH = 1 << 19
UNIFORM = 1 / (4 * np.pi)
# Shadow rays of a point towards a declared light.
SHADOW_RAYS = 16


@dataclass(frozen=True)
class AirLight:
    """Light that arrives at N points."""

    half_a: np.ndarray
    """[N, 9, 3] float32 irradiance harmonics from the first half of the paths."""
    half_b: np.ndarray
    """[N, 9, 3] float32 irradiance harmonics from the second half."""
    e_a: np.ndarray
    """[N, 3] irradiance for the given normals from the first half, without harmonics; 0 without normals."""
    e_b: np.ndarray
    """[N, 3] irradiance from the second half."""

    @property
    def sh(self) -> np.ndarray:
        """[N, 9, 3] mean of both halves."""
        return 0.5 * (self.half_a + self.half_b)

    @property
    def irradiance(self) -> np.ndarray:
        """[N, 3] mean of both halves."""
        return 0.5 * (self.e_a + self.e_b)


def air_light(
    scene: Scene,
    points: np.ndarray,
    paths: int,
    seed: int,
    *,
    normals: np.ndarray | None = None,
    variable: Variable | None = None,
    light: np.ndarray | None = None,
    numbers: np.ndarray | None = None,
    direct: bool = True,
    calls: int = 1,
    emitters: Sequence[int] = (),
) -> AirLight:
    """Path trace the light at points in air.

    Args:
        scene: The scene.
        points: [N, 3] points, metres.
        paths: Paths per point, even and ≥ 2.
        seed: Seed of the paths; the same seed gives the same bits.
        normals: [N, 3] unit normals for which irradiance is estimated too, without harmonics; None to leave it out.
        variable: Declared light of 1 cd (1 lx), of which only the indirect light is traced, because renderers add the
            direct light; None for the scene's own emitters, direct and indirect.
        light: [3] or [N, 3] position (or direction) of the declared light.
        numbers: [N] random streams of the points, which make their bits independent of the other points; None for
            their indices.
        direct: Include the light that arrives straight from the scene's own emitters.
        calls: Calls with the same points, this one included; of all but the first, workers need no points.
        emitters: Indices of the scene's own emitters that shine; empty: all of them.

    Returns:
        Light of each half of the paths.

    Raises:
        ValueError: ``paths`` is odd or below 2.
    """
    check_halves(paths)
    stream = (np.arange(len(points)) if numbers is None else numbers).astype(np.uint32)
    columns = _air_columns(points, stream, None if variable is None else light, normals)
    told = None if variable is None else to_json(variable)
    settings = {"paths": paths, "seed": seed, "direct": direct, "variable": told, "emitters": [*emitters]}
    recipe = None
    if normals is None and (variable is None or np.ndim(light) == 1):
        place = None if variable is None else np.float32(light).tolist()
        recipe = Recipe("air-points", {"light": place}, {"point": points, "stream": stream}, calls)
    rows = rows_of(scene, "air-light", settings, columns, paths, recipe=recipe)["rows"]
    sh = rows[..., :27].reshape(-1, 2, 9, 3) * TO_IRRADIANCE[:, None].astype(np.float32)
    return AirLight(sh[:, 0], sh[:, 1], rows[:, 0, 27:], rows[:, 1, 27:])


def direct_irradiance(
    scene: Scene, points: np.ndarray, normals: np.ndarray, variable: Variable, light: np.ndarray, seed: int
) -> np.ndarray:
    """Trace what ``air_light`` leaves out of a declared light, because renderers add it: its direct irradiance.

    Args:
        scene: The scene.
        points: [N, 3] points, metres.
        normals: [N, 3] unit normals.
        variable: Declared light of 1 cd (1 lx).
        light: [3] its position or direction.
        seed: Seed of the shadow rays.

    Returns:
        [N, 3] irradiance; of a day that of the sun alone, of an environment map that turns nothing.
    """
    if isinstance(variable, Turning):
        return np.zeros((len(points), 3))
    bare = replace(variable, sky=None) if has_sky(variable) else variable
    tables(scene)
    lane = dr.arange(mi.UInt32, len(points) * SHADOW_RAYS)
    row = lane // SHADOW_RAYS
    p, n = (dr.gather(kind, upload(kind, a), row) for kind, a in ((mi.Point3f, points), (mi.Vector3f, normals)))
    at = dr.zeros(mi.SurfaceInteraction3f, dr.width(lane))
    at.p, at.t = p, mi.Float(0)
    rng = random_streams(dr.opaque(mi.UInt32, seed & 0xFFFFFFFF), row, lane % SHADOW_RAYS)
    source = declared(bare, mi.Vector3f(*(dr.full(mi.Float, float(c), dr.width(lane)) for c in light)), scene)
    u = mi.Point2f(rng.next_float32(), rng.next_float32())
    wo, weight, _, delta, shadow = source.sample(scene.mi, at, u, mi.Bool(True))
    T, _ = unblocked(scene.mi, source.panes, shadow, dr.max(weight) > 0, delta)
    value = dr.select(T > 0, T * weight * dr.maximum(dr.dot(n, wo), 0), 0)
    found = np.stack([np.array(dr.block_sum(c, SHADOW_RAYS)) for c in value], axis=1) / SHADOW_RAYS
    return found * (variable.sunlight(light[None]) if has_sky(variable) else 1.0)


def air_inputs(scene: Scene, settings: Mapping[str, Any], arrays: Arrays) -> Inputs:
    """Give points in air their light; see ``row_recipes.RecipeFunction``.

    Args:
        scene: Not used.
        settings: ``light``, [3] or None.
        arrays: ``point`` [N, 3] and ``stream`` [N].

    Returns:
        Columns of ``air_light_rows``, without normals.
    """
    return Inputs(_air_columns(arrays["point"], arrays["stream"], settings["light"]))


def _air_columns(points: np.ndarray, stream: np.ndarray, light: Any, normals: np.ndarray | None = None) -> Arrays:
    """Columns of ``air_light_rows``."""
    columns = {"point": points, "normal": np.zeros_like(points) if normals is None else normals, "stream": stream}
    if light is not None:
        columns["light"] = np.broadcast_to(np.float32(light), (len(points), 3))
    return columns


def air_light_rows(scene: Scene, settings: Mapping[str, Any], columns: Arrays, first: int, shared: Arrays) -> Arrays:
    """Trace rows of ``air_light``; see ``row_tasks.RowFunction``.

    Args:
        scene: The scene.
        settings: ``paths``, ``seed``, ``direct``, ``variable`` and ``emitters``.
        columns: ``point``, ``normal`` and, with a variable, ``light`` [N, 3] each, and ``stream`` [N].
        first: Not used: every row has the number of its stream.
        shared: Not used.

    Returns:
        ``rows`` [N, 2, 30]: by half nine harmonics and the cosine, times three colours.
    """
    tables(scene)
    paths, count = settings["paths"], len(columns["point"])
    half = paths // 2
    variable = None if settings["variable"] is None else from_json(settings["variable"])
    place, normal = upload(mi.Point3f, columns["point"]), upload(mi.Vector3f, columns["normal"])
    lights = None if variable is None else upload(mi.Vector3f, columns["light"])
    streams = upload_integers(columns["stream"])
    own = GroupEmitters.of(scene, settings["emitters"]) if settings["emitters"] else Emitters.of(scene)
    numbers = [dr.opaque(mi.UInt32, v) for v in (settings["seed"] & 0xFFFFFFFF, MAX_DEPTH, RR_DEPTH, half)]
    batch = max(1, LAUNCH // paths)
    rows = np.zeros((count, 2, 30), np.float32)
    for start in range(0, count, batch):
        span = (start, min(batch, count - start), half)
        found = _launch(scene, place, normal, streams, numbers, span, variable, lights, settings["direct"], own)
        rows[start : start + span[1]] = found / half
    return {"rows": rows}


def _launch(scene: Scene, place, normal, streams, settings, span, variable, lights, direct, emitters) -> np.ndarray:
    """[count, 2, 30] sums of radiance times harmonics, and of radiance times cosine."""
    seed, max_depth, rr_depth, size = settings
    start, count, half = span
    lane = dr.arange(mi.UInt32, count * 2 * half)
    group, path = lane // size, lane % size
    row = dr.opaque(mi.UInt32, start) + group // 2
    stream = dr.gather(mi.UInt32, streams, row)
    rng = random_streams(seed, stream, (group & 1) * size + path)
    shift = random_streams(seed, stream, LATTICE_STREAM + (group & 1))
    p, n = dr.gather(mi.Point3f, place, row), dr.gather(mi.Vector3f, normal, row)
    source = emitters if variable is None else declared(variable, dr.gather(mi.Vector3f, lights, row), scene)
    u = stratified(shift, path, size)[1]
    columns = _arriving(scene.mi, p, n, source, rng, u, max_depth, rr_depth, variable is None and direct)
    dr.eval(columns)
    return np.stack([np.array(dr.block_sum(c, half)) for c in columns], axis=1).reshape(count, 2, 30)


def _arriving(geometry, p, n, source, rng, u, max_depth, rr_depth, own: bool) -> list[Any]:
    """30 numbers of one path: nine harmonics and the cosine, times three colours."""
    totals = [mi.Float(0)] * 30
    at = dr.zeros(mi.SurfaceInteraction3f, dr.width(p))
    at.p, at.t = p, mi.Float(0)
    # A sky and an environment map that turns are learned whole; a sun is the rasteriser's, as any declared light.
    straight = own or source.first_hit
    # ------------------------ Emitter sampling ------------------------
    if straight:
        wo, weight, pdf, delta, shadow = source.sample(
            geometry, at, mi.Point2f(rng.next_float32(), rng.next_float32()), mi.Bool(True)
        )
        lit = (dr.max(weight) > 0) & (mi.Bool(own) | ~delta)
        T, _ = unblocked(geometry, source.panes, shadow, lit, delta)
        mis = dr.select(delta, 1, power_heuristic(pdf, UNIFORM))
        totals = _added(totals, wo, n, dr.select(lit, T * mis * weight, 0))
    # --------------------- Uniformly distributed ray ---------------------
    d = mi.warp.square_to_uniform_sphere(u)
    ray = mi.Ray3f(p, d)
    si = geometry.ray_intersect(ray)
    L = dr.select(si.is_valid(), trace(geometry, si, source, rng, independent(rng), max_depth - 1, rr_depth, True), 0)
    if straight:
        Le, hit_pdf = source.hit(geometry, interaction_at(at), si, ray, mi.Bool(False), mi.Bool(True))
        L += power_heuristic(mi.Float(UNIFORM), hit_pdf) * Le
    return _added(totals, d, n, L / UNIFORM)


def _added(totals: list[Any], d, n, L) -> list[Any]:
    """Totals plus radiance L from direction d."""
    # A lamp at the very place of the probe has no direction.
    known = dr.all(dr.isfinite(d))
    L, d = dr.select(known & dr.all(dr.isfinite(L)), L, 0), dr.select(known, d, n)
    factors = [*sh_components(d.x, d.y, d.z, 3), dr.maximum(dr.dot(n, d), 0)]
    return [t + f * c for t, (f, c) in zip(totals, ((f, c) for f in factors for c in L))]
