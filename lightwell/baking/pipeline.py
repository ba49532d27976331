"""The stages of a bake, in order: load, declare, trace and train, score, write."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.asset.page import write_page
from lightwell.asset.records import FieldEntry
from lightwell.asset.write import write_glb
from lightwell.baking.progress import Progress
from lightwell.baking.rounds import Rounds
from lightwell.baking.score import Learned, Score, score_bake, warnings
from lightwell.baking.settings import BakeSettings
from lightwell.baking.work import Work, check_output
from lightwell.core.output import BAKE_FILES, holds_output
from lightwell.fields import starter
from lightwell.report.html import write_report
from lightwell.scenes import load
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable, declare, to_json

# Share of the budget that the static field gets when the scene has lights of its own.
STATIC_SHARE = 0.4


@holds_output("bake", lambda settings: BAKE_FILES)
def bake(settings: BakeSettings, progress: Progress | None = None) -> dict[str, Any]:
    """Run the main job; returns the content of ``report.json``. Raises ValueError for what the user can cure."""
    progress = progress or Progress(quiet=True)
    if settings.field == "lightmap":
        from lightwell.baking.lightmap import bake_lightmap

        return bake_lightmap(settings, progress)
    starter(settings.field, settings.preset)
    scene = load(settings.scene, limits=settings.limits, unit=settings.unit, allow_paths=settings.allow_paths)
    check_output(settings.out)
    _check_geometry(scene)
    variable = declare(settings.vary, scene)
    sample_lights(scene, variable, 1, settings.seed)  # refuses a box without air before any work is done
    work = Work(settings)
    work.open(scene)
    for warning in warnings(scene, variable):
        progress.say(f"[yellow]warning[/] {warning}")
    learned, rounds = _learn(scene, variable, settings, work, progress)
    with work.timed("evaluate"):
        score = score_bake(scene, variable, settings, work, learned, rounds, progress)
    with work.timed("write"):
        report = _write(scene, variable, settings, learned, score, progress)
    work.close()
    progress.say(_verdict(report, settings.out))
    return report


def _check_geometry(scene: Scene) -> None:
    if not scene.meshes or not sum(len(mesh.indices) for mesh in scene.meshes):
        raise ValueError(f"bake: scene '{scene.source}' has no triangles; nothing can be lit")


# ---------------------------------------------------------------------- learn


def _learn(
    scene: Scene, variable: Variable, settings: BakeSettings, work: Work, progress: Progress
) -> tuple[list[Learned], list[Rounds]]:
    """The field of the declared light and, where the scene has lights of its own, theirs."""
    seconds = settings.budget.round_seconds
    static = settings.static and scene.has_static_light
    shares = {"indirect": 1 - STATIC_SHARE, "static": STATIC_SHARE} if static else {"indirect": 1.0}
    learned, all_rounds = [], []
    for role, share in shares.items():
        rounds = Rounds(scene, variable, role, settings, work, progress, share * seconds)
        fit, unit = rounds.run()
        learned.append(Learned(role, fit, unit, fit.lower()))
        all_rounds.append(rounds)
    return learned, all_rounds


# ---------------------------------------------------------------------- write


def _write(
    scene: Scene,
    variable: Variable,
    settings: BakeSettings,
    learned: list[Learned],
    score: Score,
    progress: Progress,
) -> dict[str, Any]:
    """Write all files; each appears whole or not at all."""
    entries = [FieldEntry(f.role, f.role, f.graph, 0 if f.role == "indirect" else None) for f in learned]
    stage = score.stage
    variables = [to_json(variable, stage.views[0][1], stage.intensity, stage.color)]
    glb = settings.out / "scene.glb"
    size = write_glb(glb, scene, entries, variables)
    report = write_report(settings.out, replace(score.data, asset_bytes=size)).numbers
    write_page(
        settings.out / "index.html",
        title=_title(scene),
        glb=glb.read_bytes(),
        home=stage.views[0][0],
        views=score.pictures,
        exposure=score.exposure,
        report=report,
    )
    intensity = stage.intensity * np.asarray(stage.color)
    for f in learned:
        # A field may have files of its own, beside the asset.
        if more := getattr(f.fit, "write_files", None):
            told = more(settings.out, f.role, glb.read_bytes(), stage.views[0][1], intensity, settings.keep)
            progress.say(f"{f.role}: {told}")
    return report


def _title(scene: Scene) -> str:
    return (scene.name or Path(scene.source).stem or "scene").replace("_", " ")


def _verdict(report: dict[str, Any], out: Path) -> str:
    return (
        f"[bold]error {report['relative_error']:.1%}[/] (noise of the truth {report['noise_floor']:.1%}), "
        f"{report['psnr_db']:.1f} dB, {report['bytes'] / 1024:.0f} KiB of learned light, "
        f"{report['macs_per_pixel']:,} MAC per pixel\n"
        f"{out / 'scene.glb'}  {out / 'report.html'}  open with: lightwell view {os.fspath(out)}"
    )
