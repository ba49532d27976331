"""What a bake achieved: everything that the report and the page show of it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from lightwell.asset.page import PageView
from lightwell.baking import evaluate
from lightwell.baking.cost import cost
from lightwell.baking.effort import Effort
from lightwell.baking.progress import Progress
from lightwell.baking.rounds import Rounds
from lightwell.baking.settings import MIDDLE_GREY, BakeSettings
from lightwell.baking.truth import trace_points, trace_sweep, trace_view
from lightwell.baking.work import Work
from lightwell.core.denoise import missing
from lightwell.doctor import versions
from lightwell.fields import Fit
from lightwell.graph import Graph
from lightwell.report.records import PointComparison, ReportData
from lightwell.report.summary import point_scores
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable, first_settings


@dataclass(frozen=True)
class Learned:
    """One finished field."""

    role: str
    fit: Fit
    unit: float
    graph: Graph


@dataclass(frozen=True)
class Stage:
    """What is looked at, under which light."""

    views: list[tuple[Camera, np.ndarray]]
    """Held-out cameras, each with a held-out light; the first is where the page opens."""
    intensity: float
    """Candela or lux that the light has first."""
    color: tuple[float, float, float]


@dataclass(frozen=True)
class Score:
    """The finished comparison with the truth."""

    data: ReportData
    stage: Stage
    pictures: list[PageView]
    exposure: float


def score_bake(
    scene: Scene,
    variable: Variable,
    settings: BakeSettings,
    work: Work,
    learned: list[Learned],
    rounds: list[Rounds],
    progress: Progress,
) -> Score:
    """Compare the baked graphs, as they ship, with path-traced truth."""
    baked = {field.role: evaluate.Baked(field.graph) for field in learned}
    effort = _effort(settings, rounds)
    with progress.stage("compare", settings.views + 3, "with the truth") as bar:
        views = evaluate.views_and_lights(scene, variable, settings.views, settings.seed)
        declared, color = first_settings(settings.vary)
        stage = Stage(views, declared or _intensity(learned), color)
        names = evaluate.object_names(scene)
        truths = trace_points(scene, variable, list(baked), effort, settings.seed)
        points = {role: evaluate.compare_points(truths[role], baked[role], names) for role in baked}
        bar.advance()
        sweep = evaluate.light_sweep(
            trace_sweep(scene, variable, effort, settings.seed), baked["indirect"], learned[0].unit
        )
        bar.advance()
        compared = []
        for k, (camera, light) in enumerate(views):
            size, paths = settings.view_size, effort.pixel_paths
            truth = trace_view(scene, variable, camera, light, list(baked), size, paths, stage.intensity)
            name, caption = evaluate.view_name(camera, k), evaluate.view_caption(variable, light)
            compared.append(evaluate.compare_view(truth, baked, size, name, caption, stage.intensity))
            bar.advance()
        pictures = evaluate.page_views(
            scene,
            variable,
            views,
            settings.view_size,
            effort.picture_spp,
            stage.intensity,
            color,
            "static" in baked,
        )
        bar.advance()
    data = ReportData(
        scene=scene.name,
        field=settings.field,
        preset=settings.preset,
        seed=settings.seed,
        points=points["indirect"],
        views=compared,
        **cost([field.graph for field in learned]),
        seconds={name: round(value, 3) for name, value in work.seconds.items()},
        paths=sum(r.paths for r in rounds),
        paths_per_second=_rate(work, rounds),
        versions=versions(),
        settings=_settings_json(settings, variable, rounds, learned, points),
        training=_training_curve(learned[0].fit, work.seconds),
        sweep=sweep,
        warnings=warnings(scene, variable),
        unit=learned[0].unit,
        facts=facts_of(learned[0].fit),
    )
    return Score(data, stage, pictures, exposure(pictures))


def facts_of(fit: Fit) -> dict[str, Any]:
    """What a fit tells of itself (``Fit.facts``, optional): JSON values, numbers of NumPy included."""
    return json.loads(json.dumps(getattr(fit, "facts", None) or {}, default=_plain))


def _plain(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"facts must be JSON values, found a {type(value).__name__}")


def warnings(scene: Scene, variable: Variable) -> list[str]:
    """What the scene could not express, and paths that a point light cannot find."""
    found = [*scene.warnings, *filter(None, [missing()])]
    delta = sorted(
        {scene.materials[mesh.material].name for mesh in scene.meshes if scene.materials[mesh.material].delta}
    )
    if delta and getattr(variable, "radius", 1.0) == 0.0:
        size = 0.01 * scene.extent
        found.append(
            f"materials {', '.join(delta[:6])} are mirrors or clear glass: a point light's caustics are missing; "
            f"give the light a size with --vary {variable.name}.radius={size:.3g}"
        )
    return found


def _rate(work: Work, rounds: list[Rounds]) -> float:
    """Light paths per second of tracing, sampling of points included."""
    return sum(r.paths for r in rounds) / max(work.seconds.get("trace", 0.0), 1e-9)


def _effort(settings: BakeSettings, rounds: list[Rounds]) -> Effort:
    width, height = settings.view_size
    return Effort.of_budget(settings.budget.round_seconds, rounds[0].path_rate, width * height * settings.views)


def _intensity(learned: list[Learned]) -> float:
    """Intensity that makes the light's indirect radiance about 0.25, or as bright as the scene's own light."""
    static = next((field.unit for field in learned if field.role == "static"), 1.0)
    return float(f"{static / learned[0].unit:.3g}")


def exposure(views: list[PageView]) -> float:
    """Brings log-average luminance to middle grey (Reinhard et al. 2002): half way between the first and the brightest
    picture, so that neither is lost."""
    averages = []
    for view in views:
        luminance = view.reference.reshape(-1, 3) @ (0.2126, 0.7152, 0.0722)
        lit = luminance[luminance > 1e-6]
        if len(lit):
            averages.append(float(np.mean(np.log(lit))))
    if not averages:
        return 1.0
    return float(f"{MIDDLE_GREY / np.exp(0.5 * (averages[0] + max(averages))):.3g}")


def _settings_json(
    settings: BakeSettings,
    variable: Variable,
    rounds: list[Rounds],
    learned: list[Learned],
    points: dict[str, PointComparison],
) -> dict[str, Any]:
    budget = settings.budget
    facts: dict[str, Any] = {
        "scene": settings.scene,
        "variable": json.loads(json.dumps(asdict(variable))),
        "budget_seconds": budget.seconds,
        "budget_error": budget.error,
        "paths_per_sample": settings.paths,
        "plans": {r.role: r.plan_json() for r in rounds},
        "dropped_paths": sum(r.dropped for r in rounds),
    }
    for field in learned[1:]:
        scores = point_scores(points[field.role], field.unit)
        facts[f"{field.role}_field"] = {k: scores[k] for k in ("relative_error", "noise_floor", "energy_ratio")}
    return facts


def _training_curve(fit: Fit, seconds: dict[str, float]) -> list[tuple[float, float]]:
    """(seconds of tracing and training, validation error); training time is spread evenly over the steps."""
    history = fit.state.history
    if not history:
        return []
    traced = seconds.get("trace", 0.0)
    per_step = seconds.get("train", 0.0) / max(history[-1][0], 1)
    return [(traced + per_step * step, error) for step, _, error in history]
