"""The bake: prepare, sample, fit and lower with the interface of a field; score the result; write it.

No step depends on the name of a field. Only this module and ``comparison`` call ``lightwell.fields.protocol``.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from lightwell.asset.exposure import declared_exposure
from lightwell.asset.page import write_page
from lightwell.asset.records import FieldEntry, LampEntry
from lightwell.asset.write import write_glb
from lightwell.baking.environment import environment_entry
from lightwell.baking.evaluate import Shipped, lit_views
from lightwell.baking.exposure import metered_exposure
from lightwell.baking.late_notes import LateNotes
from lightwell.baking.poses import view_pose
from lightwell.baking.reference import Reference, trace_reference
from lightwell.baking.refusals import refuse_declared, refuse_sky
from lightwell.baking.score import reference_budget, score, variable_json, warnings
from lightwell.baking.settings import BakeSettings, Reported, request_of
from lightwell.baking.view_setup import ViewSetup, choose_stage
from lightwell.cluster.attach import attached
from lightwell.core.environment_text import ROTATED
from lightwell.core.lamps import parse_lamps
from lightwell.core.output import BAKE_FILES, holds_output
from lightwell.core.progress import Progress
from lightwell.core.units import size_text, time_text
from lightwell.core.vary import parse_vary
from lightwell.core.work import Work
from lightwell.fields.base import NoLight
from lightwell.fields.budget import DEFAULT_QUALITY, estimate
from lightwell.fields.protocol import ExtraFile, Field, Fit, Job, ReBake, Role, Shown, State, further_role, kind_of
from lightwell.fields.registry import check_preset, field_of, find_field, preset_of
from lightwell.fields.request import Request
from lightwell.fields.surface.roles import light_declared
from lightwell.files import write_atomically
from lightwell.report.html import write_report
from lightwell.report.records import PageLink, ReportData
from lightwell.scenes import load
from lightwell.scenes.edits import edited
from lightwell.scenes.lamp_clips import lamp_clips
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import by_light, to_json
from lightwell.transport.environment import with_turning

if TYPE_CHECKING:
    from lightwell.baking.comparison import CompareSettings
    from lightwell.baking.preview import Preview

# The page of every bake.
PAGE = PageLink("index.html", "open the scene")


@holds_output("bake", lambda settings: BAKE_FILES)
def bake(
    settings: BakeSettings,
    progress: Progress | None = None,
    *,
    started: float | None = None,
    preview: Preview | None = None,
) -> dict[str, Any]:
    """Learn the indirect light of a scene; write the asset, its page and its report.

    A mistake of the user is a ``ValueError`` of one line with the cure, a file that cannot be read or written an
    ``OSError``. Nothing is left half-written.

    Args:
        settings: Settings of the bake.
        progress: Bars and lines on standard error; None: no output.
        started: ``perf_counter()`` when the budget began to count; None: now.
        preview: Shows what is learned while it is learned; None: nothing is shown.

    Returns:
        The content of ``report.json``, or of ``rebake.json`` for an incremental bake.
    """
    started, progress = perf_counter() if started is None else started, progress or Progress(quiet=True)
    name = settings.field or field_of(settings.preset)
    field = find_field(name)
    check_preset(name, settings.preset)
    preset = preset_of(name, settings.preset, settings.quality)
    scene = loaded(settings)
    work = Work(settings, scene.digest, started)
    work.seconds["load"] = work.elapsed
    request = replace(Request(**request_of(settings)), preset=preset)
    job = Job(scene, request, settings.options, work, progress, observer=preview)
    with attached(scene, settings.loading, settings, progress.say):
        report = _baked(settings, name, field, job, preview)
    if preview:
        preview.finished(settings.out)
    work.close()
    return report


def _baked(settings: BakeSettings, name: str, field: Field, job: Job, preview: Preview | None) -> dict[str, Any]:
    """Learn, score and write."""
    if preview and any(parse_vary(text).moves for text in job.request.vary):
        raise ValueError("bake: --preview shows one pose; leave it out, or drop the node from --vary")
    if preview and len(by_light(job.request.vary)) > 1:
        raise ValueError("bake: --preview shows one light; leave it out, or drop a light from --vary")
    if preview:
        preview.begin(job.scene, job.request)
    refuse_declared(name, field, job)
    state = field.prepare(job)
    refuse_sky(name, field, state)
    if job.request.lamps and not state.lamps and parse_lamps(job.request.lamps).mode != "none":
        raise ValueError(f"bake: field '{name}' learns all lights together; use --field factored, or leave out --lamps")
    # Damaged animations of lamps are refused before anything is traced.
    state.warnings.extend(lamp_clips(job.scene, state.lamps)[1])
    _say_plan(settings, name, job.progress)
    for warning in warnings(state):
        job.progress.say(f"[yellow]warning[/] {warning}")
    fits = learn(field, state)
    settings = preview.scored(settings) if preview else settings
    shipped = [Shipped.of(role, fit, fit.lower()) for role, fit in fits.items()]
    if again := state.finished(fits):
        return _write_rebake(state, settings, shipped, again)
    return _score_and_write(state, settings, name, shipped)


def loaded(settings: BakeSettings | CompareSettings) -> Scene:
    """Load the scene of a bake.

    Args:
        settings: Settings with the scene and how to load it.

    Returns:
        The scene.

    Raises:
        ValueError: The scene has no triangles, no environment map that could turn as is declared, or not what is
            edited; or a cluster is to trace edits.
    """
    if settings.edits and settings.cluster:
        raise ValueError("bake: --cluster traces the scene of the file; leave it out, or --edits")
    scene = load(settings.scene, **settings.loading)
    scene = with_turning(edited(scene, settings.edits) if settings.edits else scene, settings.vary)
    if scene.surrounding is not None and settings.cluster:
        raise ValueError(f"bake: --cluster traces what stands still; leave it out, or drop {ROTATED} from --vary")
    if not scene.meshes or not sum(len(mesh.indices) for mesh in scene.meshes):
        raise ValueError(f"bake: scene '{scene.source}' has no triangles; nothing can be lit")
    return scene


def learn(field: Field, state: State) -> dict[Role, Fit]:
    """Sample and fit every role of a prepared scene.

    A light that may be anywhere because none was declared is left out where no surface reflects it to another one, as
    in a scene of a single sphere, if the scene has light of its own.

    Args:
        field: The field.
        state: The prepared scene; it loses the role of such a light.

    Returns:
        The fit of each role.

    Raises:
        NoLight: A light that was declared, or the only one, reaches nothing; one line with the cure.
    """
    fits: dict[Role, Fit] = {}
    for role in state.roles:
        try:
            fits[role] = field.fit(state, role, field.sample(state, role))
        except NoLight:
            if state.roles != ("indirect", "static") or fits or light_declared(state.job):
                raise
            told = f"no surface of scene '{state.scene.name}' reflects light to another: only its own light is baked"
            state.warnings.append(told)
            state.job.progress.say(f"[yellow]warning[/] {state.warnings[-1]}")
            state.variable, state.roles = None, ("static",)
    return fits


# ---------------------------------------------------------------------- score and write


def _score_and_write(state: State, settings: BakeSettings, name: str, shipped: Sequence[Shipped]) -> dict[str, Any]:
    job, roles = state.job, [s.role for s in shipped]
    units = {s.role: s.fit.unit for s in shipped}
    first = next((s for s in shipped if s.role == "indirect"), shipped[0])
    notes = LateNotes(job.progress)
    stage = choose_stage(state.scene, state.variable, units, settings, state.more)
    exposure = attempt_exposure(state, stage, settings, notes)
    budget = reference_budget(settings, job, first.fit, len(roles))
    # The asset is written before anything is scored, because scoring may fail.
    with job.work.timed("write"):
        size = write_asset(settings.out, state, shipped, shown_lights(state, stage), exposure)
    with job.work.timed("evaluate"):
        reference = trace_reference(
            state.scene, state.variable, roles, units, settings, budget, notes, job.progress, stage=stage
        )
        told, seconds = _told(settings, state, shipped), job.work.seconds
        data = score(state, settings, name, shipped, reference, seconds, told, budget, notes)
        traced = seconds.get("trace", 0.0)
        data = replace(data, training=[(traced + seconds, error) for seconds, error in data.training])
    data = replace(data, seconds={name: round(value, 3) for name, value in job.work.seconds.items()})
    with job.work.timed("write"):
        pages: list[str] = []
        try:
            pages = _write_files(settings, job, shipped, partial(_shown, stage))
        finally:  # also where a file of the field fails
            links = [PAGE, *(PageLink(name, f"{Path(name).stem} page") for name in pages)]
            data = replace(data, asset_bytes=size, links=links)
            report = write_report_and_page(settings.out, state, data, reference, notes, exposure)
    job.progress.say(_verdict(report, settings, job.work.elapsed))
    return report


def _told(settings: BakeSettings, state: State, shipped: Sequence[Shipped]) -> dict[str, Any]:
    """Settings as they are written to the report."""
    return {
        "scene": settings.scene,
        "variable": variable_json(state.variable),
        **({"further_variables": [variable_json(light) for light in state.more]} if state.more else {}),
        "quality": settings.quality,
        "budget_seconds": settings.budget.seconds,
        "budget_error": settings.budget.error,
        "paths_per_sample": next((s.fit.traced.each for s in shipped if s.fit.traced.each), settings.paths),
        "plans": {s.role: s.fit.plan for s in shipped},
        "dropped_paths": sum(s.fit.traced.dropped for s in shipped),
    }


def attempt_exposure(state: State, stage: ViewSetup, settings: Reported, notes: LateNotes) -> float | None:
    """Meter the exposure of a bake.

    Args:
        state: The prepared scene.
        stage: Views and their lights.
        settings: Seed of the bake.
        notes: Takes a note where it cannot be metered.

    Returns:
        Factor on radiance before tone mapping; None where it could not be metered.
    """
    with_static = "static" in state.roles
    make = partial(metered_exposure, state.scene, state.variable, stage, settings.seed, with_static)
    return notes.attempt("the exposure", make, None)


def shown_lights(state: State, stage: ViewSetup) -> list[dict[str, Any]]:
    """Write the lights that vary as entries of an asset, as they are shown first.

    Args:
        state: The prepared scene.
        stage: Where the lights stand in the views, and how bright they are.

    Returns:
        JSON objects, the first light first; none where no light varies.
    """
    if state.variable is None:
        return []
    first = to_json(state.variable, stage.views[0][1], stage.intensity, stage.color)
    return [first, *(to_json(light.variable, light.places[0], light.intensity, light.color) for light in stage.more)]


def write_asset(
    out: Path,
    state: State,
    shipped: Sequence[Shipped],
    variables: Sequence[dict[str, Any]],
    exposure: float | None = None,
) -> int:
    """Write ``scene.glb``.

    Args:
        out: Folder.
        state: The prepared scene.
        shipped: The fits of all roles.
        variables: JSON objects of the lights that vary, the first one first.
        exposure: Factor on radiance before tone mapping that suits the scene; None: the file has none.

    Returns:
        Bytes of the file.
    """
    number = {"indirect": 0} | {further_role(light.name): 1 + k for k, light in enumerate(state.more)}
    lamps = [LampEntry(group.name, group.nodes) for group in state.lamps]
    entries = [
        FieldEntry(s.lowered.name or s.role, kind_of(s.role), s.lowered.graph, number.get(s.role), s.lowered.pictures)
        for s in shipped
    ]
    probes = [
        FieldEntry(s.role, kind_of(s.role), s.lowered.probes, number.get(s.role)) for s in shipped if s.lowered.probes
    ]
    fallback = next((s.lowered.fallback for s in shipped if s.lowered.fallback), None)
    shines = state.scene.surrounding is not None or any(s.role == "static" for s in shipped)
    return write_glb(
        out / "scene.glb",
        state.shipped,
        entries,
        variables,
        fallback=fallback,
        lamps=lamps,
        exposure=exposure,
        pose=view_pose(state.scene, 0),
        probes=probes,
        clips=lamp_clips(state.job.scene, state.lamps)[0],
        environment=environment_entry(state.scene, state.lamps, exposure) if shines else None,
    )


def write_report_and_page(
    out: Path, state: State, data: ReportData, reference: Reference, notes: LateNotes, exposure: float | None
) -> dict[str, Any]:
    """Write ``report.html``, ``report.json`` and ``index.html``.

    Args:
        out: Folder of the bake, which holds ``scene.glb``.
        state: The prepared scene.
        data: Content of the report.
        reference: Views and pictures of the page.
        notes: Takes a note where figures or pictures must be left out.
        exposure: Factor on radiance before tone mapping; None: the page meters it.

    Returns:
        The content of ``report.json``.
    """
    bare = replace(data, points=None, views=(), sweep=(), training=(), facts={})
    written = notes.attempt("the figures", lambda: write_report(out, data), None)
    if written is None:
        written = write_report(out, replace(bare, warnings=[*data.warnings, *notes.texts]))
    page = {
        "title": _title(state.scene),
        "glb": _asset(out),
        "home": reference.stage.views[0][0],
        "exposure": exposure,
        "report": written.numbers,
        "links": {"report": "report.html"} | {link.text: link.href for link in data.links if link is not PAGE},
    }
    make = partial(write_page, out / "index.html", **page, views=reference.pictures)
    if not notes.attempt("the pictures of the page", make, 0):
        write_page(out / "index.html", **page)
    return written.numbers


def _write_rebake(state: State, settings: BakeSettings, shipped: Sequence[Shipped], again: ReBake) -> dict[str, Any]:
    strength = max(float(again.shown.intensity.max()), 1e-30)
    color = tuple(again.shown.intensity / strength)
    # What is shown beside the earlier bake is exposed as it is.
    exposure = declared_exposure(Path(again.facts["from"]) / "scene.glb")
    variables = [] if state.variable is None else [to_json(state.variable, again.shown.light, strength, color)]
    size = write_asset(settings.out, state, shipped, variables, exposure)
    _write_files(settings, state.job, shipped, lambda role: again.shown)
    if again.page:
        home = lit_views(state.scene, state.variable, 1, settings.seed)[0][0]
        page = {"title": _title(state.scene), "glb": _asset(settings.out), "home": home, "exposure": exposure}
        write_page(settings.out / PAGE.href, **page)
    told = again.facts | {"bytes": size}
    write_atomically(settings.out / "rebake.json", json.dumps(told, indent=1) + "\n")
    for line in again.lines:
        state.job.progress.say(line)
    return told


def _shown(stage: ViewSetup, role: Role) -> Shown:
    """The light of a role as it is shown first."""
    light = next((light for light in stage.more if light.role == role), stage)
    return Shown(stage.place(role, 0), light.intensity * np.asarray(light.color))


def _write_files(settings: Reported, job: Job, shipped: Sequence[Shipped], shown: Callable[[Role], Shown]) -> list[str]:
    """Write the files of a field beside the asset; the names of those that are pages."""
    pages: list[str] = []
    store = job.work.store if job.work.keep else None
    for s in shipped:
        files: list[ExtraFile] = s.fit.files(settings.out / "scene.glb", shown(s.role), store)
        for file in files:
            file.write(settings.out / file.name)
            pages += [file.name] if file.media_type == "text/html" else []
        if s.fit.note:
            job.progress.say(f"{s.role}: {s.fit.note}")
    return pages


def _asset(out: Path) -> bytes:
    return (out / "scene.glb").read_bytes()


def _title(scene: Scene) -> str:
    return (scene.name or Path(scene.source).stem or "scene").replace("_", " ")


def _say_plan(settings: BakeSettings, name: str, progress: Progress) -> None:
    """Say how long the bake will take, and where its quality changes nothing else."""
    if getattr(settings.options, "rebake", None):
        return
    if not (settings.steps and settings.shards) and (text := estimate(settings.budget)):
        progress.say(text)
    if settings.quality != DEFAULT_QUALITY and preset_of(name, settings.preset, settings.quality) == settings.preset:
        progress.say(f"field '{name}' keeps the sizes of its preset: --quality changes the time alone")


def _shown_figures(report: Mapping[str, Any]) -> dict[str, Any]:
    """Figures of the page and of the last line; those of pictures are left out where noise hides them."""
    quality = report.get("quality") or {}
    hidden = quality.get("bounds") or {}
    pictures = {name: None if name in hidden else quality.get(name) for name in ("psnr_db", "flip")}
    return {name: value for name, value in {**report, **pictures}.items() if value is not None}


def _verdict(report: Mapping[str, Any], settings: BakeSettings, seconds: float) -> str:
    figures, out, asked = "not scored", settings.out, settings.budget.seconds
    took = time_text(seconds) + (f" of {time_text(asked)}" if asked and not settings.steps else "")
    if report["relative_error"] is not None:
        figures = f"error {report['relative_error']:.1%} (noise of the reference {report['noise_floor']:.1%})"
    psnr = _shown_figures(report).get("psnr_db")
    decibels = "" if psnr is None else f", {psnr:.1f} dB"
    return (
        f"[bold]{report['verdict'] or 'not judged'}[/]\n"
        f"{figures}{decibels}, {size_text(report['bytes'])} of learned light, "
        f"{report['macs_per_pixel']:,} MAC per pixel; {took}\n"
        f"report: {out / 'report.html'}, glTF: {out / 'scene.glb'}\n"
        f"open {out / 'index.html'}, or run: lightwell view {os.fspath(out)}"
    )
