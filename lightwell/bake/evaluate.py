"""Scores the baked field, as it ships, against path-traced truth at held-out lights and views."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lightwell.asset.page import PageView
from lightwell.backend import dr, mi
from lightwell.fields import query_inputs
from lightwell.graph import Compiled, Graph, compile
from lightwell.report.records import PointComparison, ViewComparison
from lightwell.scenes.placing import held_out_lights, initial_light, sample_cameras
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable
from lightwell.transport import Query, draw_surface, indirect, make_query, static
from lightwell.transport.camera import gbuffer, total_image

# Streams of random numbers that evaluation never shares with training.
EVALUATION_SEED = 0x5EED

# Role of a field ('indirect' or 'static') → what it predicts, reflectance multiplied in.
Fields = dict[str, Callable[[Query], np.ndarray]]


@dataclass(frozen=True)
class Effort:
    """How exact the truth is; the noise floor is reported beside every error."""

    points: int = 4096
    point_paths: int = 1024
    lights: int = 32
    pixel_paths: int = 192
    picture_spp: int = 96
    sweep: int = 16
    sweep_points: int = 256
    sweep_paths: int = 256

    @staticmethod
    def within(seconds: float, paths_per_second: float, pixels: int) -> Effort:
        """Path counts that take about ``seconds`` at a measured rate; ``pixels`` over all views."""
        budget = seconds * paths_per_second
        even = lambda paths: max(int(paths) // 2 * 2, 8)  # noqa: E731
        return Effort(
            point_paths=min(even(0.20 * budget / 4096), 8192),
            pixel_paths=min(even(0.45 * budget / pixels), 4096),
            picture_spp=min(even(0.25 * budget / pixels), 1024),
            sweep_paths=min(even(0.10 * budget / (16 * 256)), 4096),
        )


class Baked:
    """A shading graph as it ships, evaluated on queries: radiance with the reflectance multiplied in."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self._compiled: Compiled = compile(graph)

    def __call__(self, query: Query) -> np.ndarray:
        """[N, 3] radiance for a unit light."""
        inputs = query_inputs(query)
        columns = {name: [mi.Float(np.ascontiguousarray(c)) for c in inputs[name].T] for name in self.graph.inputs}
        radiance = self._compiled(columns)["radiance"]
        dr.eval(radiance)
        return np.stack([np.array(channel) for channel in radiance], axis=1) * query.reflectance


def views_and_lights(scene: Scene, variable: Variable, count: int, seed: int) -> list[tuple[Camera, np.ndarray]]:
    """Held-out views: the scene's first camera with a well-placed light, then sampled cameras with held-out lights."""
    cameras = sample_cameras(scene, variable, count, seed + EVALUATION_SEED, authored=True)
    held_out = held_out_lights(scene, variable, max(count, 4), seed + EVALUATION_SEED)
    chosen = []
    for k, camera in enumerate(cameras):
        light = initial_light(scene, variable, camera) if k == 0 else _best_lit(scene, variable, camera, held_out)
        chosen.append((camera, np.asarray(light, np.float32)))
    return chosen


def _best_lit(scene: Scene, variable: Variable, camera: Camera, lights: np.ndarray) -> np.ndarray:
    """The held-out light by which the camera's picture has most indirect light, seen coarsely: no black pictures."""
    points, mask, _ = gbuffer(scene, camera, 16, 10)
    points = points[np.flatnonzero(mask)]
    if not len(points):
        return lights[0]
    means = []
    for light in lights:
        a, b = indirect(scene, points, light, variable, 16, EVALUATION_SEED)
        # The median keeps a light beside one wall from winning by one bright spot.
        means.append(np.median((a + b).mean(axis=1)))
    return lights[int(np.argmax(means))]


def compare_points(
    scene: Scene, variable: Variable, fields: Fields, effort: Effort, seed: int
) -> dict[str, PointComparison]:
    """Area-uniform points, each with a view of its own, under held-out lights; one comparison per field."""
    draw = draw_surface(scene, effort.points, seed + EVALUATION_SEED)
    lights = held_out_lights(scene, variable, effort.lights, seed + 2 * EVALUATION_SEED)
    light = lights[np.arange(effort.points) % len(lights)]
    query = make_query(scene, draw.points, light)
    names = [mesh.name or f"mesh {k}" for k, mesh in enumerate(scene.meshes)]
    compared = {}
    for name, baked in fields.items():
        a, b = _truth(scene, variable, name, draw.points, light, effort.point_paths, seed)
        compared[name] = PointComparison(baked(query), a, b, draw.points.shape, names, draw.weight)
    return compared


def _truth(scene, variable, field: str, points, light, paths: int, seed: int):
    """Two halves of what a field of that role should give."""
    if field == "static":
        return static(scene, points, paths, seed + EVALUATION_SEED)
    return indirect(scene, points, light, variable, paths, seed + EVALUATION_SEED)


def compare_view(
    scene: Scene,
    variable: Variable,
    camera: Camera,
    light: np.ndarray,
    fields: Fields,
    size: tuple[int, int],
    paths: int,
    name: str,
    intensity: float,
) -> ViewComparison:
    """One view: what the learned light adds up to for a light of 1 cd (1 lx), against the truth at the same points.

    The scene's own light is weighed as on the page, where the declared light has ``intensity``.
    """
    width, height = size
    points, mask, _ = gbuffer(scene, camera, width, height)
    seen = np.flatnonzero(mask)
    query = make_query(scene, points[seen], light)
    total = [np.zeros((len(seen), 3)) for _ in range(3)]
    for field, baked in fields.items():
        scale = 1.0 / intensity if field == "static" else 1.0
        halves = _truth(scene, variable, field, points[seen], light, paths, 1)
        for sum_, part in zip(total, (baked(query), *halves)):
            sum_ += scale * part
    images = np.zeros((3, height * width, 3), np.float32)
    images[:, seen] = total
    prediction, a, b = images.reshape(3, height, width, 3)
    where = ", ".join(f"{c:.2f}" for c in light)
    kind = "light at" if variable.kind == "point" else "sun towards"
    return ViewComparison(name, prediction, a, b, caption=f"{kind} ({where})")


def page_views(
    scene: Scene,
    variable: Variable,
    views: Sequence[tuple[Camera, np.ndarray]],
    size: tuple[int, int],
    spp: int,
    intensity: float,
    color: tuple[float, float, float],
    with_static: bool,
) -> list[PageView]:
    """The references that the page shows: complete path-traced pictures."""
    made = []
    for k, (camera, light) in enumerate(views):
        picture = total_image(
            scene, camera, light, variable, *size, spp, k, intensity=intensity, color=color, with_static=with_static
        )
        made.append(PageView(camera.name or f"view {k + 1}", camera, tuple(float(c) for c in light), picture))
    return made


def light_sweep(
    scene: Scene, variable: Variable, baked: Callable[[Query], np.ndarray], unit: float, effort: Effort, seed: int
) -> list[tuple[float, float, float]]:
    """(place on the sweep, relative error, noise floor) along a chain of held-out lights, each next to the last."""
    lights = _chain(held_out_lights(scene, variable, effort.sweep, seed + 3 * EVALUATION_SEED))
    draw = draw_surface(scene, effort.sweep_points, seed + 3 * EVALUATION_SEED, floor=0)
    rows = []
    for k, light in enumerate(lights):
        a, b = indirect(scene, draw.points, light, variable, effort.sweep_paths, seed + k)
        f, a, b = (x / unit for x in (baked(make_query(scene, draw.points, light)), a, b))
        y = 0.5 * (a + b)
        error = np.mean(np.abs(f - y) / (y + 0.01))
        floor = np.mean(np.abs(a - b) / 2 / (y + 0.01))
        rows.append((k / max(len(lights) - 1, 1), float(error), float(floor)))
    return rows


def _chain(lights: np.ndarray) -> np.ndarray:
    """The lights in an order in which each is the nearest of those left: a walk through the box."""
    left, order = list(range(1, len(lights))), [0]
    while left:
        nearest = min(left, key=lambda k: float(np.linalg.norm(lights[k] - lights[order[-1]])))
        left.remove(nearest)
        order.append(nearest)
    return lights[order]
