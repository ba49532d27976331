"""How far a light map is from the truth, computed from the file as it ships."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.asset.page import PageView
from lightwell.asset.read import read_fields
from lightwell.bake.effort import EVALUATION_SEED, Effort
from lightwell.bake.evaluate import Baked, object_names, view_name
from lightwell.bake.progress import Progress
from lightwell.bake.score import exposure
from lightwell.bake.settings import BakeSettings
from lightwell.doctor import versions
from lightwell.fields.lightmap import LightmapFit
from lightwell.report.records import PointComparison, ReportData, ViewComparison
from lightwell.scenes.atlas import Atlas
from lightwell.scenes.placing import sample_cameras
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import declare
from lightwell.transport import draw_surface, static
from lightwell.transport.camera import gbuffer
from lightwell.transport.mapped import mapped_query

# Paths per second that the effort reckons with, until a scene's own rate is known.
RATE = 3e5


@dataclass(frozen=True)
class LightmapScore:
    """The finished comparison."""

    data: ReportData
    cameras: list[Camera]
    pictures: list[PageView]
    exposure: float


def score_lightmap(
    scene: Scene, atlas: Atlas, fit: LightmapFit, settings: BakeSettings, progress: Progress
) -> LightmapScore:
    """Score OUT/scene.glb at held-out points and views."""
    field = read_fields(settings.out / "scene.glb")[0][0]
    baked = Baked(field.graph)
    width, height = settings.view_size
    effort = Effort.of_budget(settings.budget.round_seconds, RATE, width * height * settings.views)
    variable = declare((), scene)
    cameras = sample_cameras(scene, variable, settings.views, settings.seed + EVALUATION_SEED, authored=True)
    views, pictures = [], []
    with progress.stage("compare", len(cameras) + 1, "with the truth") as bar:
        points = _points(scene, atlas, baked, effort, settings.seed)
        bar.advance()
        for k, camera in enumerate(cameras):
            view, emission = compare_camera(scene, atlas, baked, camera, (width, height), effort.pixel_paths, k)
            views.append(view)
            shown = (view.reference + emission).astype(np.float32)
            pictures.append(PageView(view_name(camera, k), camera, (0.0, 0.0, 0.0), shown))
            bar.advance()
    graph = field.graph
    stored = sum(len(p.data) for p in fit.pictures.values())
    stored += sum(b.nbytes for name, b in graph.buffers.items() if name not in fit.pictures)
    data = ReportData(
        scene=scene.name,
        field="lightmap",
        preset=settings.preset,
        seed=settings.seed,
        points=points,
        views=views,
        bytes=stored,
        compressed_bytes=stored,
        parameters=graph.parameters,
        macs_per_pixel=graph.macs,
        fetches_per_pixel=graph.fetches,
        seconds={},
        paths=0,
        paths_per_second=0.0,
        versions=versions(),
        settings={"scene": settings.scene, "budget_seconds": settings.budget.seconds, "size": atlas.size},
        training=[],
        unit=fit.unit,
    )
    return LightmapScore(data, cameras, pictures, exposure(pictures))


def _points(scene: Scene, atlas: Atlas, baked: Baked, effort: Effort, seed: int) -> PointComparison:
    draw = draw_surface(scene, effort.points, seed + EVALUATION_SEED)
    a, b = static(scene, draw.points, effort.point_paths, seed + EVALUATION_SEED)
    query = mapped_query(scene, atlas, draw.points)
    return PointComparison(baked(query), a, b, draw.points.shape, object_names(scene), draw.weight)


def compare_camera(
    scene: Scene, atlas: Atlas, baked: Baked, camera: Camera, size: tuple[int, int], paths: int, number: int = 0
) -> tuple[ViewComparison, np.ndarray]:
    """One held-out picture of the still light, emission left out; and the emission that the camera sees."""
    width, height = size
    points, mask, emission = gbuffer(scene, camera, width, height)
    seen = np.flatnonzero(mask)
    a, b = static(scene, points[seen], paths, EVALUATION_SEED + number)
    images = np.zeros((3, height * width, 3), np.float32)
    images[:, seen] = baked(mapped_query(scene, atlas, points[seen])), np.nan_to_num(a), np.nan_to_num(b)
    prediction, half_a, half_b = images.reshape(3, height, width, 3)
    view = ViewComparison(view_name(camera, number), prediction, half_a, half_b, caption="the scene's own light")
    return view, emission.reshape(height, width, 3)
