"""Scores of a field for the report and the page."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from lightwell.baking import evaluate
from lightwell.baking.cost import cost
from lightwell.baking.evaluate import Shipped
from lightwell.baking.late_notes import LateNotes
from lightwell.baking.light_states import axis_of, axis_of_mover, errors_over_light, states_of_view, times_of_day
from lightwell.baking.moved_objects import moved_objects
from lightwell.baking.poses import leak_facts, pose_caption, pose_facts, view_pose
from lightwell.baking.quality import Quality, quality_of_reference, score_quality
from lightwell.baking.reference import Reference, ViewReference, halves_of
from lightwell.baking.reference_budget import ReferenceBudget, reference_seconds, shared_seconds
from lightwell.baking.settings import Reported
from lightwell.core.denoise import missing
from lightwell.core.formats import JSON
from lightwell.doctor import versions
from lightwell.fields.budget import BEST, scoring_seconds
from lightwell.fields.protocol import Fit, Job, State
from lightwell.report.records import MovedObject, PointComparison, ReportData, ViewComparison
from lightwell.report.summary import point_scores
from lightwell.report.verdict import Verdict, verdict
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable, has_sky
from lightwell.transport import SurfacePoints


def reference_budget(settings: Reported, job: Job, fit: Fit, roles: int = 1) -> ReferenceBudget:
    """Choose the path counts of the reference, at the rate that was measured before the fit; they are kept.

    Args:
        settings: Views and time of the report.
        job: The bake, with the wall time so far.
        fit: The fit.
        roles: Parts of the light that are scored.

    Returns:
        The budget.
    """
    width, height = settings.view_size

    def make() -> dict[str, Any]:
        seconds = _reference_seconds(settings, job)
        return asdict(ReferenceBudget.within(seconds, fit.traced.rate, width * height * settings.views, roles))

    return ReferenceBudget(**job.work.part(views=settings.views).get("plan.reference", make, JSON))


def _reference_seconds(settings: Reported, job: Job) -> float:
    if settings.truth:
        return settings.truth.round_seconds
    seconds = settings.budget.round_seconds
    if job.shared:
        return shared_seconds(seconds)
    fixed = settings.budget.error or (settings.steps and settings.shards)
    return reference_seconds(scoring_seconds(seconds) if fixed else seconds - job.work.elapsed)


def score(
    state: State,
    settings: Reported,
    field: str,
    shipped: Sequence[Shipped],
    reference: Reference,
    seconds: dict[str, float],
    facts: dict[str, Any],
    budget: ReferenceBudget,
    notes: LateNotes,
) -> ReportData:
    """Compare the written graphs with the reference.

    Args:
        state: The prepared scene.
        settings: Settings of the bake or comparison.
        field: Name of the field.
        shipped: One field per role; the headline is that of the variable light, or of the only one.
        reference: Traced for the same roles.
        seconds: Wall time by stage.
        facts: Further settings for the report; JSON values.
        budget: What the reference may cost.
        notes: One line for each part that could not be traced; black views are added.

    Returns:
        The content of a report, without the size of the asset.
    """
    # The headline is that of the variable light, or of the only field.
    first, *others = ordered = sorted(shipped, key=lambda s: s.role != "indirect")
    names, traced = evaluate.object_names(state.scene), reference.points
    points = {s.role: evaluate.compare_points(traced[s.role], s, names) for s in ordered if s.role in traced}
    views = _compare_views(state, reference, ordered, settings.view_size, names, notes)
    facts |= notes.attempt("the errors of the other parts of the light", partial(_of_roles, others, points), {})
    quality, judged = _judge(state, settings, reference, budget, ordered, notes)
    balls = partial(moved_objects, state, reference.stage, ordered)
    moved: list[MovedObject] = notes.attempt("the pictures of what probes light", balls, [])
    paths = sum(s.fit.traced.paths for s in shipped)
    # Both before the notes are listed.
    told = facts_of(ordered) | _facts_of_states(state, reference, ordered, points, budget, notes)
    sweep = notes.attempt("the error along the path of the light", partial(_sweep, state, reference, first), {})
    return ReportData(
        scene=state.scene.name,
        field=field,
        preset=state.job.request.preset,
        seed=settings.seed,
        points=points.get(first.role),
        views=views,
        **cost([s.lowered for s in shipped]),
        seconds={name: round(value, 3) for name, value in seconds.items()},
        paths=paths,
        paths_per_second=paths / max(seconds.get("trace", 0.0), 1e-9),
        versions=versions(),
        settings=facts,
        training=first.fit.training.curve,
        **sweep,
        warnings=[*warnings(state), *notes.texts],
        facts=told,
        unit=first.fit.unit,
        quality=quality,
        verdict=judged,
        moved=moved,
    )


def _sweep(state: State, reference: Reference, first: Shipped) -> dict[str, Any]:
    """Errors along the path of the light, and what the chart shows to the right."""
    variable, mover = state.variable, next(iter(state.scene.movers), None)
    return {
        "sweep": [] if reference.sweep is None else evaluate.light_sweep(reference.sweep, first, variable, mover),
        "sweep_axis": axis_of(variable) if mover is None else axis_of_mover(mover),
    }


def _facts_of_states(
    state: State,
    reference: Reference,
    ordered: Sequence[Shipped],
    points: Mapping[str, PointComparison],
    budget: ReferenceBudget,
    notes: LateNotes,
) -> dict[str, Any]:
    """Errors by pose and over the lights, without those that cannot be computed."""
    of_poses = partial(_pose_facts, state, reference, ordered[0], points, budget, notes)
    of_lights = partial(_light_facts, state, reference, ordered, points)
    found: dict[str, Any] = notes.attempt("the errors by pose", of_poses, {})
    return found | notes.attempt("the errors over the lights", of_lights, {})


def _pose_facts(
    state: State,
    reference: Reference,
    first: Shipped,
    points: Mapping[str, PointComparison],
    budget: ReferenceBudget,
    notes: LateNotes,
) -> dict[str, Any]:
    """Errors by pose, and what leaks at the end stops, where something moves."""
    scene, found = state.scene, points.get(first.role)
    if not scene.movers or found is None:
        return {}
    light, traced = reference.stage.views[0][1], reference.points[first.role].points

    def halves(at: SurfacePoints, lights: np.ndarray, paths: int) -> tuple[np.ndarray, np.ndarray]:
        return halves_of(scene, state.variable, first.role, at, lights, paths, state.job.request.seed)

    facts = pose_facts(scene, traced, first, (found.prediction, found.half_a, found.half_b))
    for k, of_mover in enumerate(facts):
        leak = partial(leak_facts, scene, k, first, light, halves, budget)
        of_mover["end_stops"] = notes.attempt(f"the leak at the end stops of {of_mover['name']}", leak, [])
    return {"movers": facts}


def _light_facts(
    state: State, reference: Reference, shipped: Sequence[Shipped], points: Mapping[str, PointComparison]
) -> dict[str, Any]:
    """Errors of a day's twilight, low sun and high sun, and over lights that the sweep does not show."""
    facts: dict[str, Any] = {"errors_over_lights": []}
    for s in shipped:
        variable, found = state.for_role(s.role).variable, points.get(s.role)
        if s.role == "static" or found is None:
            continue
        lights, unit = reference.points[s.role].light, s.fit.unit
        if has_sky(variable):
            facts.setdefault("times_of_day", times_of_day(found, lights, variable, unit))
        swept = s is shipped[0] and not state.scene.movers
        if states := None if swept else errors_over_light(found, lights, variable, unit):
            facts["errors_over_lights"].append({"axis": axis_of(variable), "states": states})
    return {key: value for key, value in facts.items() if value}


def _of_roles(shipped: Sequence[Shipped], points: Mapping[str, PointComparison]) -> dict[str, Any]:
    """Errors of the fields beside the headline."""
    scores = {s.role: point_scores(points[s.role], s.fit.unit) for s in shipped if s.role in points}
    keys = ("relative_error", "error_without_noise", "noise_floor", "energy_ratio")
    return {f"{role}_field": {key: found[key] for key in keys} for role, found in scores.items()}


def _compare_views(
    state: State,
    reference: Reference,
    ordered: Sequence[Shipped],
    size: tuple[int, int],
    names: Sequence[str],
    notes: LateNotes,
) -> list[ViewComparison]:
    """The views that were traced, each beside the learned light of all roles."""
    views, stage = [], reference.stage
    for k, ((camera, light), view, display) in enumerate(zip(stage.views, reference.views, reference.display)):
        if view is None:
            continue
        stands = view_pose(state.scene, k)
        pose = pose_caption(state.scene, stands)
        name, caption = evaluate.view_name(camera, k), evaluate.view_caption(state.variable, light, pose)
        further = [evaluate.view_caption(other.variable, other.places[k]) for other in stage.more]
        caption = "; ".join([caption, *further])
        lights = [(state.variable, light), *((other.variable, other.places[k]) for other in stage.more)]
        states = states_of_view(lights, state.scene.movers, stands)
        views.append(evaluate.compare_view(view, ordered, size, name, caption, stage, k, names, display, states))
        if not views[-1].reference.any():
            notes.add(f"{name} shows no indirect light: its figures say little")
    return views


def _judge(
    state: State,
    settings: Reported,
    reference: Reference,
    budget: ReferenceBudget,
    ordered: Sequence[Shipped],
    notes: LateNotes,
) -> tuple[dict[str, Any] | None, Verdict | None]:
    """Figures of what the pictures show, and the verdict in words."""
    size, stage = settings.view_size, reference.stage
    numbers = {id(view): k for k, view in enumerate(reference.views)}

    def shown(view: ViewReference) -> np.ndarray:
        k = numbers[id(view)]
        return sum(stage.weight(s.role) * s.at(view.points, stage.place(s.role, k)) for s in ordered)

    def make() -> Quality | None:
        truth = quality_of_reference(state.scene, state.variable, reference, size, budget, settings.seed, notes)
        return None if truth is None else score_quality(truth, ordered[0].at, shown)

    figures = notes.attempt("the figures of quality", make, None)
    if figures is None:
        return None, None
    names = [evaluate.view_name(c, k) for k, ((c, _), v) in enumerate(zip(reference.stage.views, reference.views)) if v]
    told = figures.json()
    return told, verdict(told, names, figures.per_view, cure=_cure(settings.quality), bounds=figures.bounds)


def _cure(quality: str) -> str:
    """The option that a user can try next."""
    return "a longer --budget" if quality == BEST else f"--quality {BEST}"


def facts_of(shipped: Sequence[Shipped]) -> dict[str, Any]:
    """Merge the facts of all fits; where two have the same name, the first fit's counts.

    Args:
        shipped: The fits.

    Returns:
        JSON values.
    """
    told = {}
    for s in reversed(shipped):
        told |= s.fit.facts
    return json.loads(json.dumps(told, default=_plain))


def _plain(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"facts must be JSON values, found a {type(value).__name__}")


def warnings(state: State) -> list[str]:
    """List features of the scene that are not supported, and light paths that a point light cannot find.

    Args:
        state: The prepared scene.

    Returns:
        One line each.
    """
    scene, variable = state.scene, state.variable
    found = [*scene.warnings, *filter(None, [missing()]), *state.warnings]
    delta = sorted(_mirrors(scene))
    if delta and variable is not None and getattr(variable, "radius", 1.0) == 0.0:
        size = 0.01 * scene.extent
        found.append(
            f"materials {', '.join(delta[:6])} are mirrors or clear glass: what they focus of a point light (caustics) "
            f"is missing; give the light a size with --vary {variable.name}.radius={size:.3g}"
        )
    return found


def _mirrors(scene: Scene) -> set[str]:
    materials = (scene.materials[mesh.material] for mesh in scene.meshes)
    return {material.name for material in materials if material.delta}


def variable_json(variable: Variable | None) -> dict[str, Any] | None:
    """Convert the ranges of a light to JSON values.

    Args:
        variable: The ranges; None: no light varies.

    Returns:
        JSON values; None without a variable light.
    """
    return None if variable is None else json.loads(json.dumps(asdict(variable)))
