"""The truth that fields are scored against: traced once, however many fields there are, and kept on disk.

Every record holds N surface points as queries and two independent halves of their path-traced radiance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeVar

import numpy as np

from lightwell.baking.effort import EVALUATION_SEED, Effort
from lightwell.files import load_arrays, save_arrays
from lightwell.scenes.placing import held_out_lights
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable
from lightwell.transport import Query, draw_surface, indirect, make_query, static
from lightwell.transport.camera import gbuffer


@dataclass(frozen=True)
class PointTruth:
    """Area-uniform points, each with a view of its own, under held-out lights."""

    query: Query
    half_a: np.ndarray
    """[N, 3] mean over the first half of the paths, for a light of 1 cd (1 lx)."""
    half_b: np.ndarray
    """[N, 3] ... over the second half."""
    shape: np.ndarray
    """[N] index into ``Scene.meshes``."""
    weight: np.ndarray
    """[N] makes means area-uniform."""


@dataclass(frozen=True)
class ViewTruth:
    """The surface points that the pixels of one picture show."""

    query: Query
    half_a: np.ndarray
    """[N, 3] as in ``PointTruth``; the scene's own light is weighed in."""
    half_b: np.ndarray
    seen: np.ndarray
    """[N] pixels of the points, row-major; the other pixels show no surface."""


@dataclass(frozen=True)
class SweepTruth:
    """The same few points under a chain of held-out lights, light-major."""

    query: Query
    half_a: np.ndarray
    half_b: np.ndarray
    place: np.ndarray
    """[N] number of the light along the chain."""


def trace_points(
    scene: Scene, variable: Variable, roles: Sequence[str], effort: Effort, seed: int
) -> dict[str, PointTruth]:
    """Role ('indirect' or 'static') → truth at the same held-out points."""
    draw = draw_surface(scene, effort.points, seed + EVALUATION_SEED)
    lights = held_out_lights(scene, variable, effort.lights, seed + 2 * EVALUATION_SEED)
    light = lights[np.arange(effort.points) % len(lights)]
    query = make_query(scene, draw.points, light)
    shape, weight = draw.points.shape, draw.weight
    halves = {role: _halves(scene, variable, role, draw.points, light, effort.point_paths, seed) for role in roles}
    return {role: PointTruth(query, a, b, shape, weight) for role, (a, b) in halves.items()}


def trace_view(
    scene: Scene,
    variable: Variable,
    camera: Camera,
    light: np.ndarray,
    roles: Sequence[str],
    size: tuple[int, int],
    paths: int,
    intensity: float = 1.0,
) -> ViewTruth:
    """One picture of ``size`` = (width, height) pixels.

    The scene's own light is weighed as on the page, where the declared light has ``intensity``.
    """
    points, mask, _ = gbuffer(scene, camera, *size)
    seen = np.flatnonzero(mask)
    a, b = np.zeros((2, len(seen), 3))
    for role in roles:
        halves = _halves(scene, variable, role, points[seen], light, paths, 1)
        a, b = (total + role_scale(role, intensity) * half for total, half in zip((a, b), halves))
    return ViewTruth(make_query(scene, points[seen], light), a, b, seen)


def role_scale(role: str, intensity: float) -> float:
    """Weight of a field in a picture of which the declared light has 1 cd (1 lx)."""
    return 1.0 / intensity if role == "static" else 1.0


def trace_sweep(scene: Scene, variable: Variable, effort: Effort, seed: int) -> SweepTruth:
    """A walk of the light through its box, each held-out place next to the last."""
    lights = chain(held_out_lights(scene, variable, effort.sweep, seed + 3 * EVALUATION_SEED))
    points = draw_surface(scene, effort.sweep_points, seed + 3 * EVALUATION_SEED, floor=0).points
    halves = [indirect(scene, points, light, variable, effort.sweep_paths, seed + k) for k, light in enumerate(lights)]
    a, b = (np.concatenate(parts) for parts in zip(*halves))
    rows = np.tile(np.arange(len(points)), len(lights))
    query = make_query(scene, points[rows], lights.repeat(len(points), axis=0))
    return SweepTruth(query, a, b, np.arange(len(lights)).repeat(len(points)))


def chain(lights: np.ndarray) -> np.ndarray:
    """The lights in an order in which each is the nearest of those left: a walk through the box."""
    left, order = list(range(1, len(lights))), [0]
    while left:
        nearest = min(left, key=lambda k: float(np.linalg.norm(lights[k] - lights[order[-1]])))
        left.remove(nearest)
        order.append(nearest)
    return lights[order]


def _halves(scene, variable, role: str, points, light, paths: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Two halves of what a field of that role should give, [N, 3] each."""
    if role == "static":
        return static(scene, points, paths, seed + EVALUATION_SEED)
    return indirect(scene, points, light, variable, paths, seed + EVALUATION_SEED)


# ---------------------------------------------------------------------- on disk

Record = TypeVar("Record", PointTruth, ViewTruth, SweepTruth)


def kept(path: Path, kind: type[Record], trace: Callable[[], Record]) -> Record:
    """The record in the file ``path`` (.npz), traced and written there when it is absent."""
    if not path.exists():
        _save(path, trace())
    arrays = load_arrays(path)
    query = Query(**{f.name: arrays[f"query.{f.name}"] for f in fields(Query)})
    return kind(query=query, **{f.name: arrays[f.name] for f in fields(kind) if f.name != "query"})


def _save(path: Path, record: Record) -> None:
    columns = {f.name: getattr(record, f.name) for f in fields(record) if f.name != "query"}
    columns |= {f"query.{f.name}": getattr(record.query, f.name) for f in fields(Query)}
    save_arrays(path, columns)
