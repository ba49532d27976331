"""What all fields of a comparison share: samples, the radiance unit, held-out truth, pictures."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, dataclass

import numpy as np

from lightwell.asset.page import PageView
from lightwell.baking.compare_settings import CompareSettings
from lightwell.baking.effort import Effort
from lightwell.baking.evaluate import page_views, views_and_lights
from lightwell.baking.plan import FEWEST_SHARDS, MOST_SHARDS
from lightwell.baking.progress import Progress
from lightwell.baking.tracing import TracedShards, trace_shards, validation_samples
from lightwell.baking.truth import PointTruth, SweepTruth, ViewTruth, kept, trace_points, trace_sweep, trace_view
from lightwell.baking.work import Work, write_json
from lightwell.fields import FieldSetup, radiance_unit
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable, first_settings
from lightwell.transport import Samples
from lightwell.transport.shards import ShardSettings

# Share of the budget that traces the samples; the rest trains, each field anew.
TRACE_SHARE = 0.5


@dataclass(frozen=True)
class SharedSamples:
    """Area-uniform training samples and the validation samples of early stopping."""

    training: Samples
    validation: Samples
    setup: FieldSetup
    paths: int
    """Light paths traced for training."""
    effort: Effort
    """What the truth may cost beside them."""


@dataclass(frozen=True)
class SharedTruth:
    """What every field is scored against."""

    points: PointTruth
    views: list[ViewTruth]
    sweep: SweepTruth
    cameras: list[tuple[Camera, np.ndarray]]
    """Camera and light of each view."""
    pictures: list[PageView]
    """Complete path-traced pictures, for the pages."""
    intensity: float
    """Candela or lux that the light has first."""
    color: tuple[float, float, float]


def shared_samples(
    scene: Scene, variable: Variable, settings: CompareSettings, work: Work, progress: Progress
) -> SharedSamples:
    """Trace once, or read what an earlier run has traced."""
    plan, first = work.part("samples") / "plan.json", settings.shards or FEWEST_SHARDS
    shards = ShardSettings(paths=settings.paths, seed=2 * settings.seed, lights=settings.lights_per_shard)

    def trace(count: int) -> TracedShards:
        with work.timed("trace"), progress.stage("trace", count, "shards") as stage:
            return trace_shards(scene, variable, shards, plan.parent / "uniform", count, None, stage)

    traced = None
    if not plan.exists():
        # Without a plan the shards must be timed, so that those of a run that was killed are of no use.
        shutil.rmtree(plan.parent / "uniform", ignore_errors=True)
        traced = trace(first)
        cost = max(traced.seconds_per_shard, 1e-3)
        bought = min(max(int(TRACE_SHARE * settings.budget.round_seconds / cost), FEWEST_SHARDS), MOST_SHARDS)
        effort = _effort(settings, shards.size * shards.paths / cost)
        write_json(plan, {"shards": settings.shards or bought, "effort": asdict(effort)})
    planned = json.loads(plan.read_text())
    if traced is None or planned["shards"] > first:
        traced = trace(planned["shards"])
    setup = FieldSetup.of(scene, radiance_unit(traced.samples), variable.kind, variable)
    validation = validation_samples(scene, variable, settings.seed)
    return SharedSamples(traced.samples, validation, setup, traced.report.paths, Effort(**planned["effort"]))


def _effort(settings: CompareSettings, path_rate: float) -> Effort:
    """What the truth may cost, at the measured number of paths per second."""
    width, height = settings.view_size
    pixels = width * height * settings.views
    if settings.truth:
        return Effort.within(settings.truth.round_seconds, path_rate, pixels)
    return Effort.of_budget(settings.budget.round_seconds, path_rate, pixels)


def shared_truth(
    scene: Scene,
    variable: Variable,
    settings: CompareSettings,
    shared: SharedSamples,
    work: Work,
    progress: Progress,
) -> SharedTruth:
    """Trace held-out points, views, a sweep of the light and the pages' pictures; each is kept on disk."""
    folder, effort, seed = work.part("truth"), shared.effort, settings.seed
    # Views may change between runs, so that their number and size are part of the file names.
    width, height = size = settings.view_size
    with work.timed("evaluate"), progress.stage("truth", settings.views + 3, "held-out lights and views") as bar:
        points = kept(
            folder / "points.npz",
            PointTruth,
            lambda: trace_points(scene, variable, ("indirect",), effort, seed)["indirect"],
        )
        bar.advance()
        sweep = kept(folder / "sweep.npz", SweepTruth, lambda: trace_sweep(scene, variable, effort, seed))
        bar.advance()
        cameras, views = views_and_lights(scene, variable, settings.views, seed), []
        for k, (camera, light) in enumerate(cameras):
            path = folder / f"view-{k}-of-{settings.views}-{width}x{height}.npz"
            trace = lambda c=camera, l=light: trace_view(  # noqa: E731
                scene, variable, c, l, ("indirect",), size, effort.pixel_paths
            )
            views.append(kept(path, ViewTruth, trace))
            bar.advance()
        intensity, color = first_settings(settings.vary)
        intensity = intensity or float(f"{1.0 / shared.setup.unit:.3g}")
        pictures = page_views(scene, variable, cameras, size, effort.picture_spp, intensity, color, False)
        bar.advance()
    return SharedTruth(points, views, sweep, cameras, pictures, intensity, color)
