"""Radiance queries: path-traced radiance leaving surface points towards the camera, with one light position per point.

Notation: N points, P paths per half. One lane is one path; two independent halves of P paths belong to each point. The
paths themselves are in ``paths``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import Any, TypeAlias

import numpy as np

from lightwell.backend import dr, mi, upload_integers
from lightwell.scenes.executor import Arrays, Recipe
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Turning, Variable, from_json, has_sky, to_json
from lightwell.transport.interactions import DevicePoints, gather_interaction, upload
from lightwell.transport.light_vertices import SharedLamps, light_vertices
from lightwell.transport.moved import by_pose
from lightwell.transport.path_numbers import LATTICE_STREAM, check_halves, random_streams, stratified
from lightwell.transport.path_settings import LAUNCH as LAUNCH
from lightwell.transport.path_settings import PathReport as PathReport
from lightwell.transport.path_settings import PathSettings
from lightwell.transport.paths import CONNECTIONS, DIRECT_DEPTH, FIRST_DEPTH, MAX_DEPTH, RR_DEPTH, trace
from lightwell.transport.samples import SurfacePoints, columns_of
from lightwell.transport.sources import Emitters, PointEmitter, declared
from lightwell.transport.tables import tables

Begun: TypeAlias = Callable[[], tuple[np.ndarray, np.ndarray]]
"""Waits for both halves of what was begun, [N, 3] each; called once."""


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


def begin_first_reflection(
    scene: Scene,
    points: SurfacePoints,
    light: np.ndarray,
    variable: Variable,
    paths: int,
    seed: int,
    lamps: SharedLamps | None = None,
) -> Begun:
    """Begin to trace indirect radiance that surfaces reflect which the light reaches in a straight line.

    The points see these surfaces directly, or by mirrors, glass and holes. What is left is a final gather over the
    indirect irradiance of surfaces (``radiosity``). Paths are traced while the caller does other work.

    Args:
        scene: Scene to trace.
        points: N points.
        light: [N, 3] positions of the declared light, metres (directions to the sun).
        variable: What the declared light is.
        paths: Paths per point, even, ≥ 2; each half gets ``paths / 2``.
        seed: Seed of the paths.
        lamps: The places of a point light that many points share, whose light rays then serve all of them.

    Returns:
        Waits for two independent means, [N, 3] float32 each; NaN where no path of a half is finite. Halves of points
        under the same lamp share light rays.
    """
    limits = PathSettings(paths, seed, FIRST_DEPTH, RR_DEPTH, False, 1, past_mirrors=True)
    return _begun(scene, points, limits, variable, np.asarray(light, np.float32), None, lamps=lamps)


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
    lamps: SharedLamps | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Both half means of all points, in this process or by the executor of the scene; of each pose by itself."""
    return _begun(scene, points, limits, variable, light, report, recipe, lamps)()


def _begun(
    scene: Scene,
    points: SurfacePoints,
    limits: PathSettings,
    variable: Variable | None,
    light: np.ndarray | None,
    report: PathReport | None,
    recipe: Recipe | None = None,
    lamps: SharedLamps | None = None,
) -> Begun:
    """Begin ``_traced``; without movers and executor, the last launch runs while the caller does other work."""
    if scene.movers:
        means = np.zeros((2, len(points), 3), np.float32)
        for rows, scene_of_pose, own in by_pose(scene, points):
            lit = None if light is None else light[rows]
            means[:, rows] = _traced(scene_of_pose, own, limits, variable, lit, report)
        return lambda: (means[0], means[1])
    paths = limits.paths
    check_halves(paths)
    if scene.executor is None:
        finish = _begin_means(scene, points, limits, variable, light, lamps=lamps)
    else:
        settings = {"limits": asdict(limits), "variable": None if variable is None else to_json(variable)}
        columns, shared = columns_of(points) | ({} if light is None else {"light": light}), None
        if lamps is not None:
            settings["lamp_seed"], columns["lamp"], shared = lamps.seed, lamps.index, {"places": lamps.places}
        found = scene.executor.rows("radiance", settings, columns, paths, shared, recipe=recipe)
        finish = lambda: (found["means"], found["good"])  # noqa: E731

    def halves() -> tuple[np.ndarray, np.ndarray]:
        means, good = finish()
        if report is not None:
            report.paths += len(points) * paths
            report.dropped += int(len(points) * paths - good.sum())
            report.points += int((good == 0).any(axis=1).sum())
        return means[:, 0], means[:, 1]

    return halves


def radiance_rows(scene: Scene, settings: Mapping[str, Any], columns: Arrays, first: int, shared: Arrays) -> Arrays:
    """Trace rows of ``indirect``, ``direct`` or ``static``; see ``row_tasks.RowFunction``.

    Args:
        scene: Scene to trace.
        settings: ``limits``, ``variable`` (None: the scene's own emitters) and, with shared lamps, ``lamp_seed``.
        columns: Columns of ``SurfacePoints`` and, with a variable, ``light`` [N, 3]; with shared lamps, ``lamp`` [N].
        first: Number of the first row.
        shared: With shared lamps, their ``places`` [L, 3].

    Returns:
        ``means`` [N, 2, 3] and ``good`` [N, 2], the counts of finite paths.
    """
    points = SurfacePoints(*(columns[name] for name in ("shape", "triangle", "barycentric", "view")))
    variable = None if settings["variable"] is None else from_json(settings["variable"])
    lamps = None
    if "lamp_seed" in settings:
        lamps = SharedLamps(shared["places"], columns["lamp"], settings["lamp_seed"])
    limits = PathSettings(**settings["limits"])
    means, good = _begin_means(scene, points, limits, variable, columns.get("light"), first, lamps)()
    return {"means": means, "good": good}


def _begin_means(
    scene: Scene,
    points: SurfacePoints,
    limits: PathSettings,
    variable: Variable | None,
    light: np.ndarray | None,
    first: int = 0,
    lamps: SharedLamps | None = None,
) -> Callable[[], tuple[np.ndarray, np.ndarray]]:
    """Launch all paths; the result waits for both half means of points [N, 2, 3] and counts of finite paths [N, 2]."""
    tables(scene)
    positions = None if light is None else upload(mi.Vector3f, light)
    vertices = None if lamps is None else light_vertices(scene, lamps.places, lamps.seed)
    lamp = None if lamps is None else upload_integers(lamps.index)

    def source(row, half):
        if positions is None:
            return Emitters.of(scene)
        made = declared(variable, dr.gather(mi.Vector3f, positions, row), scene)
        if isinstance(made, PointEmitter) and vertices is not None:
            made.vertices, made.group = vertices, 2 * dr.gather(mi.UInt32, lamp, row) + half
        return made

    half = limits.paths // 2
    device = DevicePoints(points)
    per_point = min(half, limits.launch // 2)  # Paths of one half in one launch
    batch = max(1, limits.launch // (2 * per_point))  # Points of one launch
    numbers = (limits.seed & 0xFFFFFFFF, limits.max_depth, limits.rr_depth, first)
    settings = [dr.opaque(mi.UInt32, v) for v in numbers]
    total = np.zeros((len(points), 2, 3), np.float64)
    good = np.zeros((len(points), 2), np.int64)

    def add(start: int, count: int, sums: tuple[mi.Spectrum, mi.UInt32]) -> None:
        total[start : start + count] += np.array(sums[0]).T.reshape(count, 2, 3)
        good[start : start + count] += np.array(sums[1]).reshape(count, 2)

    running = None
    for start in range(0, len(points), batch):
        count = min(batch, len(points) - start)
        for done in range(0, half, per_point):
            block = min(per_point, half - done)
            traced = _launch(scene, device, source, settings, (start, count, done, block, half), limits)
            # The next launch is recorded while the last one runs, whose sums wait for all that was launched.
            if running is not None:
                add(*running)
            running = start, count, _sums(*traced, block)

    def finish() -> tuple[np.ndarray, np.ndarray]:
        if running is not None:
            add(*running)
        means = np.where(good[..., None] > 0, total / np.maximum(good, 1)[..., None], np.nan).astype(np.float32)
        return means, good

    return finish


def _launch(scene, device, source, settings, span, limits):
    """Record ``block`` paths of both halves of ``count`` points: their light, and 1 where it is finite, by lane."""
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
    way = (limits.include_direct, limits.connections, False, limits.max_depth == DIRECT_DEPTH, limits.past_mirrors)
    L = trace(scene.mi, si, source(row, group & 1), rng, first, *depths, *way)
    ok = dr.all(dr.isfinite(L))
    return dr.select(ok, L, 0), dr.select(ok, mi.UInt32(1), mi.UInt32(0))


def _sums(L: mi.Spectrum, ok: mi.UInt32, block: int) -> tuple[mi.Spectrum, mi.UInt32]:
    """Launch a recording, and add up blocks of its lanes."""
    # Evaluated together and now: block_sum evaluates each of its arguments alone and would trace the paths four times.
    dr.eval(L, ok)
    result = dr.block_sum(L, block), dr.block_sum(ok, block)
    dr.eval(result)
    return result
