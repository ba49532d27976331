"""Radiance queries: path-traced radiance leaving surface points towards the camera, with one light position per point.

Notation: N points, P paths per half. One lane is one path; two independent halves of P paths belong to each point.

Algorithm: next-event estimation, BSDF sampling and (point lights) light rays of one segment, combined by the power
heuristic. Without light rays it is Mitsuba's ``path``, except that paths start on a surface and that the light is not
part of the scene. Without panes its value is that of ``path`` minus ``direct``.

Light of a point light or the sun passes holes, blended surfaces and clear glass in a straight line (``panes``).

Not supported: light of a point light or the sun by a mirror, or bent by glass (zero-measure paths: caustics are
missing; give the light a radius); participating media; polarisation.

Papers: Kajiya 1986 (path tracing); Veach 1997 (multiple importance sampling, bidirectional path tracing).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.executor import Arrays, Recipe
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Turning, Variable, from_json, has_sky, to_json
from lightwell.transport.interactions import DevicePoints, coverage, gather_interaction, upload
from lightwell.transport.moved import by_pose
from lightwell.transport.panes import first_stop, panes_of
from lightwell.transport.path_numbers import LATTICE_STREAM, next_2d, random_streams, stratified
from lightwell.transport.path_settings import LAUNCH as LAUNCH
from lightwell.transport.path_settings import PathReport as PathReport
from lightwell.transport.path_settings import PathSettings
from lightwell.transport.path_state import PathState, is_delta, power_heuristic, sample_light
from lightwell.transport.samples import SurfacePoints, columns_of
from lightwell.transport.sources import Emitters, Source, declared
from lightwell.transport.tables import tables

# Longest path, counted as Mitsuba does (2 = direct light). In a closed room of albedo 0.8 longer ones hold 0.1 %.
MAX_DEPTH = 32
# Paths of direct light alone.
DIRECT_DEPTH = 2
# Depth from which Russian roulette may end a path; Mitsuba's default.
RR_DEPTH = 5
# Vertices of a path, from the query point on, that are connected to the end of a light ray: all of them. Compared with
# emitter sampling alone it takes 1.5 times as long and has a third of the variance (Cornell box, light anywhere).
CONNECTIONS = MAX_DEPTH


def trace(
    scene: mi.Scene,
    si: mi.SurfaceInteraction3f,
    source: Source,
    rng: mi.PCG32,
    first: tuple[mi.Float, mi.Point2f, mi.Point2f],
    max_depth: mi.UInt32,
    rr_depth: mi.UInt32,
    include_direct: bool,
    connections: int = CONNECTIONS,
    see_through: bool = True,
    one_bounce: bool = False,
) -> mi.Spectrum:
    """Estimate the radiance leaving ``si`` towards ``si.wi`` that comes from ``source``; one path per lane.

    Args:
        scene: Mitsuba scene: the geometry and BSDFs.
        si: Surface interactions where the paths start.
        source: Declared light (per lane) or the scene's emitters.
        rng: PCG32, one stream per lane.
        first: (number, 2D point, 2D point) in [0, 1) that choose the lobe and the direction of the first bounce and the
            direction of the light ray: see ``path_numbers``.
        max_depth: Longest path in Mitsuba's count (2 = direct light only); opaque.
        rr_depth: Depth from which Russian roulette may end a path; opaque.
        include_direct: Count light that reaches ``si`` from the source in a straight line. Otherwise paths that find
            the source at their first bounce are dropped, and emitter sampling starts at the second vertex.
        connections: Number of vertices, from the query point on, that are connected to the surface that one ray from a
            point light meets: it samples the bright spot next to a light near a wall. 0: as Mitsuba's ``path``.
        see_through: Where ``si`` lies on a blended surface (alpha), include what is seen through it, by its coverage.
            Off: the light of the surface alone, as if its coverage were 1; a rasteriser blends it itself.
        one_bounce: ``max_depth`` is 2: where no ray can find the source, the kernel has no loop over further bounces.

    Returns:
        One estimate of the radiance per lane.
    """
    ends = one_bounce and not source.hits
    connections = 0 if one_bounce else connections
    L, z, path = _first_vertex(scene, si, source, rng, first, max_depth, include_direct, connections, see_through)
    if ends:
        return L
    limits = (max_depth, rr_depth)
    return _follow(scene, path, L, z, source, rng, limits, include_direct, connections)


@dr.syntax
def _follow(scene, path, L, z, source, rng, limits, include_direct, connections):
    """Follow paths from their first bounce; returns the radiance L with what they find."""
    max_depth, rr_depth = limits
    while dr.hint(path.active, label="lightwell radiance"):
        si = scene.ray_intersect(path.ray, mi.RayFlags.All, False, path.active)
        bsdf = si.bsdf(path.ray)

        # ------------------ The source, met by BSDF sampling ------------------

        if dr.hint(source.hits, mode="scalar"):
            Le, mis = path.meet(scene, si, source)
            L += dr.select(mi.Bool(include_direct or source.first_hit) | (path.depth > 1), path.β * mis * Le, 0)

        # ------------------ Emitter sampling, and next direction ------------------

        goes = path.active & si.is_valid() & (path.depth + 1 < max_depth)
        rays = _ray_densities(path, si, connections) if source.emits and connections > 0 else None
        light, sample, weight = _next_vertex(scene, si, bsdf, source, rng, goes, rays)
        L += path.β * light
        if dr.hint(source.emits and connections > 1, mode="scalar"):
            joined = goes & (path.depth < connections) & (path.depth + 2 < max_depth)
            L += path.β * _connect(scene, si, bsdf, source, z, joined)

        # ------------------- Loop variables and stopping criterion -------------------

        path.leave(si, sample.wo, sample.pdf, weight, sample.eta, is_delta(sample))
        factor, alive = path.roulette(rr_depth, rng.next_float32())
        path.β *= factor
        path.active = goes & alive
        path.depth += 1
    return L


def _ray_densities(path, si, connections):
    """Lanes that light rays could have found, if the vertex before was connected to them, and their density by area."""
    both = (path.depth <= connections) & ~path.prev_delta
    return both, path.prev_pdf * dr.abs(dr.dot(si.n, path.ray.d)) / dr.square(si.t)


def _first_vertex(scene, si, source, rng, first, max_depth, include_direct, connections, see_through):
    """Sample the light at the query point, and the direction in which the path leaves.

    Returns radiance, the end of the light ray (None without), and the path.
    """
    bsdf, (lobe, direction, light) = si.bsdf(), first
    L, z, stopped = mi.Spectrum(0), None, mi.Float(1) if see_through else coverage(si, bsdf)
    if include_direct or source.first_hit:
        L += _direct(scene, si, bsdf, source, rng, stopped, include_direct)
    if source.emits and connections > 0:
        z = first_stop(scene, source.panes, source.emit(light), rng)
        L += _connect(scene, si, bsdf, source, z, mi.Bool(max_depth > 2), stopped)
    # Lobes come in the order covered, seen through.
    sample, β = bsdf.sample(mi.BSDFContext(), si, lobe * stopped, direction)
    path = PathState()
    path.leave(si, sample.wo, mi.Float(sample.pdf / stopped), β, mi.Float(sample.eta), is_delta(sample))
    path.depth, path.active = mi.UInt32(1), dr.max(path.β) != 0
    return L, z, path


def _next_vertex(scene, si, bsdf, source, rng, active, rays):
    """Sample the source at a later vertex, and the direction in which the path continues.

    ``rays``: lanes that light rays could have found, and their density per area by the BSDF; None without light rays.

    Returns radiance (without the throughput up to here), the BSDF sample and its weight.
    """
    smooth = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    light = sample_light(scene, si, source, next_2d(rng), smooth)
    value, pdf, sample, weight = bsdf.eval_pdf_sample(
        mi.BSDFContext(), si, si.to_local(light.direction), rng.next_float32(), next_2d(rng), active
    )
    mis = light.mis(pdf)
    if rays is not None:
        both, by_bsdf = rays
        stops = light.chance if source.panes is None else light.chance * (1 - source.panes.passes(si, active)[1])
        mis = dr.select(both, power_heuristic(by_bsdf, _light_density(source, si) * stops), 1)
    return dr.select(light.seen, mis * value * light.weight, 0), sample, weight


def _light_density(source, si) -> mi.Float:
    """Compute the density per area at which light rays meet the surface at ``si``."""
    offset = source.position - si.p
    distance2 = dr.squared_norm(offset)
    return dr.inv_four_pi * dr.abs(dr.dot(si.n, offset)) * dr.rsqrt(distance2) / distance2


def _connect(scene, si, bsdf, source, z, active, stopped=1) -> mi.Spectrum:
    """Connect ``si`` to the light vertex ``z``, with the MIS weight against BSDF sampling, which could find z too."""
    ctx = mi.BSDFContext()
    z, T, chance = z
    offset = z.p - si.p
    distance2 = dr.squared_norm(offset)
    direction = offset * dr.rsqrt(distance2)
    z = mi.SurfaceInteraction3f(z)
    to_light = dr.normalize(source.position - z.p)
    z.wi = z.to_local(-direction)
    cosine = dr.abs(dr.dot(z.n, direction))
    density = _light_density(source, z) * chance
    active &= z.is_valid() & (distance2 > 0) & (cosine > 0) & (density > 0)
    active &= ~scene.ray_test(si.spawn_ray_to(z.p), active)
    value, pdf = (v / stopped for v in bsdf.eval_pdf(ctx, si, si.to_local(direction), active))
    reflected = z.bsdf().eval(ctx, z, z.to_local(to_light), active) / dr.squared_norm(source.position - z.p)
    mis = power_heuristic(density, pdf * cosine / distance2)
    return dr.select(active, mis * value * reflected * T * cosine / (distance2 * density), 0)


def _direct(scene, si, bsdf, source, rng, stopped, whole) -> mi.Spectrum:
    """Estimate direct light of the source at ``si``: one emitter sample with its MIS weight; all of it, or no sun."""
    light = sample_light(scene, si, source, next_2d(rng), mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth))
    value, pdf = (v / stopped for v in bsdf.eval_pdf(mi.BSDFContext(), si, si.to_local(light.direction), light.seen))
    return dr.select(light.seen & (mi.Bool(whole) | ~light.delta), light.mis(pdf) * value * light.weight, 0)


def indirect(
    scene: Scene,
    points: SurfacePoints,
    light: np.ndarray,
    variable: Variable,
    paths: int,
    seed: int,
    *,
    max_depth: int = MAX_DEPTH,
    rr_depth: int = RR_DEPTH,
    connections: int = CONNECTIONS,
    report: PathReport | None = None,
    recipe: Recipe | None = None,
    launch: int = LAUNCH,
) -> tuple[np.ndarray, np.ndarray]:
    """Trace the indirect radiance leaving points towards their views, for a white light of 1 cd (1 lx for a sun).

    The scene's own emitters do not shine. All of a sky's light counts as indirect; see ``sky_source`` for its unit.

    Args:
        scene: Scene to trace.
        points: N points.
        light: [N, 3] or [3] positions of the declared light, metres (directions to the sun).
        variable: What the declared light is.
        paths: Paths per point, even, ≥ 2; each half gets ``paths / 2``.
        seed: Seed of the paths.
        max_depth: Longest path, 2 = direct light only.
        rr_depth: Depth from which Russian roulette may end a path.
        connections: Vertices that are connected to light rays, see ``trace``.
        report: Receives the path counts.
        recipe: How workers make points and lights again; None: they are sent.
        launch: Paths that are traced at a time, ≥ 2; bounds memory.

    Returns:
        Two independent means, [N, 3] float32 each; NaN where no path of a half is finite.
    """
    light = np.broadcast_to(np.asarray(light, np.float32), (len(points), 3))
    limits = PathSettings(paths, seed, max_depth, rr_depth, False, connections, launch)
    return _traced(scene, points, limits, variable, light, report, recipe)


def direct(
    scene: Scene,
    points: SurfacePoints,
    light: np.ndarray,
    variable: Variable,
    paths: int = 2,
    seed: int = 0,
    *,
    report: PathReport | None = None,
    recipe: Recipe | None = None,
) -> np.ndarray:
    """Trace the direct radiance leaving points towards their views, for a white light of 1 cd (1 lx for a sun).

    With a sky: of its sun alone, because that of the sky is part of ``indirect``; of an environment map nothing.

    Args:
        scene: Scene to trace.
        points: N points.
        light: [N, 3] or [3] positions of the declared light, metres (directions to the sun).
        variable: What the declared light is.
        paths: Paths per point, even, ≥ 2; without a radius the light needs no more than 2.
        seed: Seed of the paths.
        report: Receives the path counts.
        recipe: How workers make points and lights again; None: they are sent.

    Returns:
        [N, 3] float32; exact for a light without radius.
    """
    light = np.broadcast_to(np.asarray(light, np.float32), (len(points), 3))
    if isinstance(variable, Turning):
        return np.zeros((len(points), 3), np.float32)
    bare = replace(variable, sky=None) if has_sky(variable) else variable
    limits = PathSettings(paths, seed, DIRECT_DEPTH, RR_DEPTH, True, CONNECTIONS)
    a, b = _traced(scene, points, limits, bare, light, report, recipe)
    return 0.5 * (a + b) * variable.sunlight(light) if has_sky(variable) else 0.5 * (a + b)


def static(
    scene: Scene,
    points: SurfacePoints,
    paths: int,
    seed: int,
    *,
    max_depth: int = MAX_DEPTH,
    rr_depth: int = RR_DEPTH,
    report: PathReport | None = None,
    recipe: Recipe | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Trace radiance leaving points from the scene's own emitters, direct and indirect, without the points' own
    emission.

    Args:
        scene: Scene to trace.
        points: N points.
        paths: Paths per point, even, ≥ 2; each half gets ``paths / 2``.
        seed: Seed of the paths.
        max_depth: Longest path, 2 = direct light only.
        rr_depth: Depth from which Russian roulette may end a path.
        report: Receives the path counts.
        recipe: How workers make points and lights again; None: they are sent.

    Returns:
        Two independent means, [N, 3] float32 each; zero in a scene without emitters.
    """
    if not scene.has_static_light:
        zero = np.zeros((len(points), 3), np.float32)
        return zero, zero.copy()
    limits = PathSettings(paths, seed, max_depth, rr_depth, True, CONNECTIONS)
    return _traced(scene, points, limits, None, None, report, recipe)


def _traced(
    scene: Scene,
    points: SurfacePoints,
    limits: PathSettings,
    variable: Variable | None,
    light: np.ndarray | None,
    report: PathReport | None,
    recipe: Recipe | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Both half means of all points, in this process or by the executor of the scene; of each pose by itself."""
    if scene.movers:
        means = np.zeros((2, len(points), 3), np.float32)
        for rows, scene_of_pose, own in by_pose(scene, points):
            lit = None if light is None else light[rows]
            means[:, rows] = _traced(scene_of_pose, own, limits, variable, lit, report)
        return means[0], means[1]
    paths = limits.paths
    if paths < 2 or paths % 2:
        raise ValueError(f"transport: paths = {paths}, expected an even number >= 2 (two independent halves)")
    if scene.executor is None:
        means, good = _means(scene, points, limits, variable, light)
    else:
        settings = {"limits": asdict(limits), "variable": None if variable is None else to_json(variable)}
        columns = columns_of(points) | ({} if light is None else {"light": light})
        found = scene.executor.rows("radiance", settings, columns, paths, recipe=recipe)
        means, good = found["means"], found["good"]
    if report is not None:
        report.paths += len(points) * paths
        report.dropped += int(len(points) * paths - good.sum())
        report.points += int((good == 0).any(axis=1).sum())
    return means[:, 0], means[:, 1]


def radiance_rows(scene: Scene, settings: Mapping[str, Any], columns: Arrays, first: int, shared: Arrays) -> Arrays:
    """Trace rows of ``indirect``, ``direct`` or ``static``; see ``row_tasks.RowFunction``.

    Args:
        scene: Scene to trace.
        settings: ``limits`` and ``variable`` (None: the scene's own emitters).
        columns: Columns of ``SurfacePoints`` and, with a variable, ``light`` [N, 3].
        first: Number of the first row.
        shared: Not used.

    Returns:
        ``means`` [N, 2, 3] and ``good`` [N, 2], the counts of finite paths.
    """
    points = SurfacePoints(*(columns[name] for name in ("shape", "triangle", "barycentric", "view")))
    variable = None if settings["variable"] is None else from_json(settings["variable"])
    means, good = _means(scene, points, PathSettings(**settings["limits"]), variable, columns.get("light"), first)
    return {"means": means, "good": good}


def _means(
    scene: Scene,
    points: SurfacePoints,
    limits: PathSettings,
    variable: Variable | None,
    light: np.ndarray | None,
    first: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Both half means of points [N, 2, 3] and counts of finite paths [N, 2], launch by launch."""
    tables(scene)
    positions = None if light is None else upload(mi.Vector3f, light)

    def source(row):
        if positions is None:
            return Emitters(panes_of(scene))
        return declared(variable, dr.gather(mi.Vector3f, positions, row), scene)

    half = limits.paths // 2
    device = DevicePoints(points)
    per_point = min(half, limits.launch // 2)  # Paths of one half in one launch
    batch = max(1, limits.launch // (2 * per_point))  # Points of one launch
    numbers = (limits.seed & 0xFFFFFFFF, limits.max_depth, limits.rr_depth, first)
    settings = [dr.opaque(mi.UInt32, v) for v in numbers]
    total = np.zeros((len(points), 2, 3), np.float64)
    good = np.zeros((len(points), 2), np.int64)
    for start in range(0, len(points), batch):
        count = min(batch, len(points) - start)
        for done in range(0, half, per_point):
            block = min(per_point, half - done)
            span = (start, count, done, block, half)
            L, ok = _launch(scene, device, source, settings, span, limits)
            total[start : start + count] += np.array(L).T.reshape(count, 2, 3)
            good[start : start + count] += np.array(ok).reshape(count, 2)
    means = np.where(good[..., None] > 0, total / np.maximum(good, 1)[..., None], np.nan).astype(np.float32)
    return means, good


def _launch(scene, device, source, settings, span, limits):
    """Trace ``block`` paths of both halves for ``count`` points; sums and counts of the finite ones, [count * 2]."""
    start, count, done, block, half = span
    seed, max_depth, rr_depth, first_row = settings
    start, done, half, size = (dr.opaque(mi.UInt32, v) for v in (start, done, half, block))
    lane = dr.arange(mi.UInt32, count * 2 * block)
    group = lane // size  # point * 2 + half
    row = start + group // 2
    path = done + lane % size
    rng = random_streams(seed, first_row + row, (group & 1) * half + path)
    # A stream beyond those of the paths, shared by all paths of a half.
    shift = random_streams(seed, first_row + row, LATTICE_STREAM + (group & 1))
    si = gather_interaction(scene, device, row)
    first = stratified(shift, path, half)
    depths = (max_depth, rr_depth)
    way = (limits.include_direct, limits.connections, False, limits.max_depth == DIRECT_DEPTH)
    L = trace(scene.mi, si, source(row), rng, first, *depths, *way)
    ok = dr.all(dr.isfinite(L))
    L, ok = dr.select(ok, L, 0), dr.select(ok, mi.UInt32(1), mi.UInt32(0))
    # Evaluated together and now: block_sum evaluates each of its arguments alone and would trace the paths four times.
    dr.eval(L, ok)
    result = dr.block_sum(L, block), dr.block_sum(ok, block)
    dr.eval(result)
    return result
