"""How far a light map is from the truth, computed from the file as it ships."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.asset.page import PageView
from lightwell.asset.read import read_fields
from lightwell.baking.effort import EVALUATION_SEED, Effort
from lightwell.baking.evaluate import Baked, object_names, view_caption, view_name, views_and_lights
from lightwell.baking.progress import Progress
from lightwell.baking.references import reference_picture
from lightwell.baking.score import exposure
from lightwell.baking.settings import BakeSettings
from lightwell.doctor import versions
from lightwell.fields.lightmap import LightmapFit
from lightwell.graph import Graph
from lightwell.report.records import PointComparison, ReportData, ViewComparison
from lightwell.scenes.atlas import Atlas
from lightwell.scenes.placing import sample_cameras
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable, declare, first_settings, to_json
from lightwell.transport import draw_surface, indirect, static
from lightwell.transport.camera import gbuffer
from lightwell.transport.mapped import mapped_query

# Paths per second that the effort reckons with, until a scene's own rate is known.
RATE = 3e5


@dataclass(frozen=True)
class LightmapStage:
    """What is looked at, and under which light."""

    views: list[tuple[Camera, np.ndarray]]
    """Held-out cameras, each with a held-out place of the light (zeros where nothing moves)."""
    variable: Variable | None
    intensity: float
    color: tuple[float, float, float]

    @property
    def variables(self) -> list[dict[str, Any]]:
        """The entries of the extension."""
        if self.variable is None:
            return []
        return [to_json(self.variable, self.views[0][1], self.intensity, self.color)]


def stage_of(
    scene: Scene, variable: Variable | None, settings: BakeSettings, fits: dict[str, LightmapFit]
) -> LightmapStage:
    """Cameras, lights, and an intensity that makes the moving light as bright as the still one."""
    seed = settings.seed + EVALUATION_SEED
    if variable is None:
        cameras = sample_cameras(scene, declare((), scene), settings.views, seed, authored=True)
        return LightmapStage([(camera, np.zeros(3, np.float32)) for camera in cameras], None, 1.0, (1.0, 1.0, 1.0))
    declared, color = first_settings(settings.vary)
    still = fits["static"].unit if "static" in fits else 1.0
    intensity = declared or float(f"{still / fits['indirect'].unit:.3g}")
    return LightmapStage(views_and_lights(scene, variable, settings.views, settings.seed), variable, intensity, color)


@dataclass(frozen=True)
class LightmapScore:
    """The finished comparison."""

    data: ReportData
    home: Camera
    pictures: list[PageView]
    exposure: float


def score_lightmap(
    scene: Scene,
    atlas: Atlas,
    fits: dict[str, LightmapFit],
    stage: LightmapStage,
    settings: BakeSettings,
    progress: Progress,
) -> LightmapScore:
    """Score OUT/scene.glb at held-out points and views."""
    graphs = {field.role: field.graph for field in read_fields(settings.out / "scene.glb")[0]}
    baked = {role: Baked(graph) for role, graph in graphs.items()}
    size = settings.view_size
    effort = Effort.of_budget(settings.budget.round_seconds, RATE, size[0] * size[1] * settings.views)
    views, pictures = [], []
    with progress.stage("compare", len(stage.views) + 1, "with the truth") as bar:
        points = _points(scene, atlas, baked, stage, effort, settings.seed)
        bar.advance()
        for k, (camera, light) in enumerate(stage.views):
            views.append(compare_camera(scene, atlas, baked, camera, size, effort.pixel_paths, k, stage, light))
            options = {"intensity": stage.intensity, "color": stage.color, "with_static": "static" in baked}
            shown = reference_picture(scene, camera, light, stage.variable, size, effort.picture_spp, k, **options)
            where = tuple(float(c) for c in light)
            pictures.append(PageView(view_name(camera, k), camera, where, shown))
            bar.advance()
    data = _report(scene, atlas, fits, graphs, points, views, settings)
    return LightmapScore(data, stage.views[0][0], pictures, exposure(pictures))


def _report(scene, atlas, fits, graphs, points, views, settings: BakeSettings) -> ReportData:
    bytes_ = sum(stored_bytes(fit, graphs[role]) for role, fit in fits.items())
    return ReportData(
        scene=scene.name,
        field="lightmap",
        preset=settings.preset,
        seed=settings.seed,
        points=points,
        views=views,
        bytes=bytes_,
        compressed_bytes=bytes_,
        parameters=sum(graph.parameters for graph in graphs.values()),
        macs_per_pixel=sum(graph.macs for graph in graphs.values()),
        fetches_per_pixel=sum(graph.fetches for graph in graphs.values()),
        seconds={},
        paths=0,
        paths_per_second=0.0,
        versions=versions(),
        settings={"scene": settings.scene, "budget_seconds": settings.budget.seconds, "size": atlas.size},
        training=[],
        unit=max(fit.unit for fit in fits.values()),
    )


def stored_bytes(fit: LightmapFit, graph: Graph) -> int:
    """Encoded pictures and the network's weights."""
    weights = sum(b.nbytes for name, b in graph.buffers.items() if name not in fit.pictures)
    return weights + sum(len(picture.data) for picture in fit.pictures.values())


def _points(
    scene: Scene, atlas: Atlas, baked: dict[str, Baked], stage: LightmapStage, effort: Effort, seed: int
) -> PointComparison:
    draw = draw_surface(scene, effort.points, seed + EVALUATION_SEED)
    lights = np.stack([light for _, light in stage.views])[np.arange(len(draw.points)) % len(stage.views)]
    a, b = _truth(scene, baked, stage, draw.points, lights, effort.point_paths, seed + EVALUATION_SEED)
    prediction = _learned(baked, stage, mapped_query(scene, atlas, draw.points, lights))
    return PointComparison(prediction, a, b, draw.points.shape, object_names(scene), draw.weight)


def _truth(scene, baked, stage, points, light, paths: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Two halves of what the fields should add up to."""
    total = np.zeros((2, len(points), 3), np.float32)
    if "static" in baked:
        total += np.stack(static(scene, points, paths, seed))
    if stage is not None and stage.variable is not None:
        total += stage.intensity * np.stack(indirect(scene, points, light, stage.variable, paths, seed))
    return total[0], total[1]


def _learned(baked: dict[str, Baked], stage: LightmapStage | None, query) -> np.ndarray:
    intensity = 1.0 if stage is None else stage.intensity
    return sum((intensity if role == "indirect" else 1.0) * field(query) for role, field in baked.items())


def compare_camera(
    scene: Scene,
    atlas: Atlas,
    baked: dict[str, Baked],
    camera: Camera,
    size: tuple[int, int],
    paths: int,
    number: int = 0,
    stage: LightmapStage | None = None,
    light: np.ndarray | None = None,
) -> ViewComparison:
    """One held-out picture, emission left out."""
    width, height = size
    points, mask, _ = gbuffer(scene, camera, width, height)
    seen = np.flatnonzero(mask)
    light = np.zeros(3, np.float32) if light is None else light
    a, b = _truth(scene, baked, stage, points[seen], light, paths, EVALUATION_SEED + number)
    images = np.zeros((3, height * width, 3), np.float32)
    images[0, seen] = _learned(baked, stage, mapped_query(scene, atlas, points[seen], light))
    images[1:, seen] = np.nan_to_num(a), np.nan_to_num(b)
    prediction, half_a, half_b = images.reshape(3, height, width, 3)
    moves = stage is not None and stage.variable is not None
    caption = view_caption(stage.variable, light) if moves else "the scene's own light"
    return ViewComparison(view_name(camera, number), prediction, half_a, half_b, caption=caption)
