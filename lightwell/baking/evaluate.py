"""Scores the baked field, as it ships, against path-traced truth at held-out lights and views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lightwell.asset.page import PageView
from lightwell.backend import dr, mi
from lightwell.baking.effort import EVALUATION_SEED
from lightwell.baking.references import reference_picture
from lightwell.baking.truth import PointTruth, SweepTruth, ViewTruth, role_scale
from lightwell.fields import query_inputs
from lightwell.graph import Compiled, Graph, compile
from lightwell.report.records import PointComparison, ViewComparison
from lightwell.scenes.placing import held_out_lights, initial_light, sample_cameras
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable
from lightwell.transport import Query, indirect
from lightwell.transport.camera import gbuffer

# Index of the region of a pixel that shows no surface.
NO_REGION = -1
# The second expert's least share in a pixel that counts as blended.
BLENDED = 0.01


class Baked:
    """A shading graph as it ships, evaluated on queries: radiance with the reflectance multiplied in."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self._compiled: Compiled = compile(graph)

    def __call__(self, query: Query) -> np.ndarray:
        """[N, 3] radiance for a unit light."""
        return self._outputs(query, ("radiance",))["radiance"] * query.reflectance

    @property
    def segmented(self) -> bool:
        """Whether several experts share the surfaces, and the graph says which."""
        return "segment" in self.graph.outputs

    def segments(self, query: Query) -> tuple[np.ndarray, np.ndarray]:
        """[N] index of each point's first expert and [N] share of its second one, in [0, 0.5]."""
        names = tuple(name for name in ("segment", "overlap") if name in self.graph.outputs)
        found = {name: value[:, 0] for name, value in self._outputs(query, names).items()}
        index = np.rint(found["segment"]).astype(np.int64)
        return index, found.get("overlap", np.zeros(len(query), np.float32))

    def _outputs(self, query: Query, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Name → [N, C] of some outputs of the graph."""
        inputs = query_inputs(query)
        columns = {name: [mi.Float(np.ascontiguousarray(c)) for c in inputs[name].T] for name in self.graph.inputs}
        outputs = self._compiled(columns)
        wanted = [outputs[name] for name in names]
        dr.eval(wanted)
        rows = lambda channels: [np.broadcast_to(np.array(c), len(query)) for c in channels]  # noqa: E731
        return {name: np.stack(rows(channels), axis=1) for name, channels in zip(names, wanted)}


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


def compare_points(truth: PointTruth, baked: Baked, objects: Sequence[str]) -> PointComparison:
    """A field against the truth at held-out points; ``objects`` names the meshes of the scene."""
    return PointComparison(baked(truth.query), truth.half_a, truth.half_b, truth.shape, objects, truth.weight)


def compare_view(
    truth: ViewTruth, fields: Mapping[str, Baked], size: tuple[int, int], name: str, caption: str, intensity: float
) -> ViewComparison:
    """One picture: what the learned light (role → field) adds up to for a light of 1 cd (1 lx), against the truth."""
    width, height = size
    total = sum(role_scale(role, intensity) * baked(truth.query) for role, baked in fields.items())
    images = np.zeros((3, height * width, 3), np.float32)
    images[:, truth.seen] = total, truth.half_a, truth.half_b
    prediction, a, b = images.reshape(3, height, width, 3)
    regions, blend = _regions(truth, fields["indirect"], size)
    return ViewComparison(name, prediction, a, b, regions, blend, caption)


def _regions(truth: ViewTruth, baked: Baked, size: tuple[int, int]) -> tuple[np.ndarray | None, np.ndarray | None]:
    """[height, width] index of the expert of every pixel and whether it is blended; None for a single network."""
    if not baked.segmented:
        return None, None
    width, height = size
    index, share = baked.segments(truth.query)
    regions = np.full(height * width, NO_REGION)
    blend = np.zeros(height * width, bool)
    regions[truth.seen], blend[truth.seen] = index, share > BLENDED
    return regions.reshape(height, width), blend.reshape(height, width)


def view_name(camera: Camera, number: int) -> str:
    """What a view is called: the camera's own name, or its number from 1."""
    return camera.name or f"view {number + 1}"


def view_caption(variable: Variable, light: np.ndarray) -> str:
    """Where the light of a view stands."""
    where = ", ".join(f"{c:.2f}" for c in light)
    return f"{'light at' if variable.kind == 'point' else 'sun towards'} ({where})"


def object_names(scene: Scene) -> list[str]:
    """A name for every mesh."""
    return [mesh.name or f"mesh {k}" for k, mesh in enumerate(scene.meshes)]


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
    """The references that the page shows: complete path-traced pictures, denoised; ``size`` is that of scored views."""
    made = []
    for k, (camera, light) in enumerate(views):
        options = {"intensity": intensity, "color": color, "with_static": with_static}
        picture = reference_picture(scene, camera, light, variable, size, spp, k, **options)
        made.append(PageView(camera.name or f"view {k + 1}", camera, tuple(float(c) for c in light), picture))
    return made


def light_sweep(truth: SweepTruth, baked: Baked, unit: float) -> list[tuple[float, float, float]]:
    """(place on the sweep in [0, 1], relative error, noise floor) along the chain of held-out lights."""
    f, a, b = (x / unit for x in (baked(truth.query), truth.half_a, truth.half_b))
    y = 0.5 * (a + b)
    error = np.mean(np.abs(f - y) / (y + 0.01), axis=1)
    floor = np.mean(np.abs(a - b) / 2 / (y + 0.01), axis=1)
    last = max(int(truth.place.max()), 1)
    lights = [truth.place == k for k in np.unique(truth.place)]
    return [(k / last, float(error[at].mean()), float(floor[at].mean())) for k, at in enumerate(lights)]
