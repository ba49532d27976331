"""Several fields on the same samples, scored against the same truth: ``lightwell compare --fields … SCENE -o OUT``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from lightwell.asset.page import write_page
from lightwell.asset.read import read_fields
from lightwell.asset.records import FieldEntry
from lightwell.asset.write import write_glb
from lightwell.baking import evaluate
from lightwell.baking.compare import aligned
from lightwell.baking.compare_samples import TRACE_SHARE, SharedSamples, SharedTruth, shared_samples, shared_truth
from lightwell.baking.compare_settings import CompareSettings, FieldChoice
from lightwell.baking.compare_train import Trained, train_field
from lightwell.baking.cost import cost
from lightwell.baking.progress import Progress
from lightwell.baking.score import exposure, facts_of, warnings
from lightwell.baking.work import Work, check_output, write_json
from lightwell.core.output import BAKE_FILES, COMPARE_FILES, holds_output
from lightwell.doctor import versions
from lightwell.graph import Graph
from lightwell.report.compare_html import ComparedField, write_comparison
from lightwell.report.html import write_report
from lightwell.report.records import ReportData
from lightwell.scenes import load
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable, declare, to_json


def _files(settings: CompareSettings) -> list[str]:
    return [*COMPARE_FILES, *(f"{choice.folder}/{name}" for choice in settings.fields for name in BAKE_FILES)]


@holds_output("compare", _files)
def compare_fields(settings: CompareSettings, progress: Progress | None = None) -> dict[str, Any]:
    """Trace once, train every field, score all; returns the content of ``compare.json``.

    A field that cannot be trained is left out and named under ``failed``. Raises ValueError for what the user can cure.
    """
    progress = progress or Progress(quiet=True)
    scene = load(settings.scene, limits=settings.limits, unit=settings.unit, allow_paths=settings.allow_paths)
    check_output(settings.out)
    variable = declare(settings.vary, scene)
    sample_lights(scene, variable, 1, settings.seed)  # refuses a box without air before any work is done
    work = Work(settings)
    work.open(scene)
    shared = shared_samples(scene, variable, settings, work, progress)
    truth = shared_truth(scene, variable, settings, shared, work, progress)
    each = Comparison(scene, variable, settings, work, progress, shared, truth)
    compared, failed = [], {}
    for choice in settings.fields:
        try:
            compared.append(each.field(choice))
        except (ValueError, RuntimeError, ArithmeticError) as error:
            failed[choice.name] = " ".join(str(error).split()) or type(error).__name__
            progress.say(f"[yellow]{choice.name} failed:[/] {failed[choice.name]}")
    if not compared:
        raise ValueError(f"compare: no field could be trained ({'; '.join(failed.values())})")
    numbers = write_comparison(settings.out, compared, failed, _settings_json(settings, variable, shared))
    work.close()
    first = settings.out / numbers["fields"][0]["folder"]
    progress.say(f"{settings.out / 'compare.html'}  open a field with: lightwell view {first}")
    return numbers


class Comparison:
    """What every field of a comparison is trained on and scored with."""

    def __init__(
        self,
        scene: Scene,
        variable: Variable,
        settings: CompareSettings,
        work: Work,
        progress: Progress,
        shared: SharedSamples,
        truth: SharedTruth,
    ) -> None:
        self.scene, self.variable, self.settings = scene, variable, settings
        self.work, self.progress, self.shared, self.truth = work, progress, shared, truth
        self._variables = [to_json(variable, truth.cameras[0][1], truth.intensity, truth.color)]
        self._exposure = exposure(truth.pictures)

    def field(self, choice: FieldChoice) -> ComparedField:
        """Train, lower, write and score one field; what an earlier run has finished is only scored."""
        work, out = self.work.part(f"fields/{choice.folder}"), self.settings.out / choice.folder
        done, glb = work / "done.json", out / "scene.glb"
        if not (done.exists() and glb.exists()):
            trained = train_field(choice, self.shared, self.settings, self._seconds, work, self.progress)
            out.mkdir(exist_ok=True)
            write_glb(glb, self.scene, [FieldEntry("indirect", "indirect", trained.fit.lower(), 0)], self._variables)
            write_json(done, _facts(trained))
        graph = read_fields(glb)[0][0].graph
        data = self._score(choice, graph, json.loads(done.read_text()), glb.stat().st_size)
        numbers = self._write(out, data)
        facts = json.loads(done.read_text())
        return ComparedField(choice.name, choice.folder, data, numbers, facts["steps"], facts["cut"])

    @property
    def _seconds(self) -> float:
        """Training time of each field: what tracing has left of the budget."""
        return (1 - TRACE_SHARE) * self.settings.budget.round_seconds

    def _score(self, choice: FieldChoice, graph: Graph, done: dict[str, Any], size: int) -> ReportData:
        """The graph, as it ships, against the truth."""
        truth, unit = self.truth, self.shared.setup.unit
        baked = evaluate.Baked(graph)
        views = []
        for k, ((camera, light), view) in enumerate(zip(truth.cameras, truth.views)):
            name, caption = evaluate.view_name(camera, k), evaluate.view_caption(self.variable, light)
            fields = {"indirect": baked}
            views.append(evaluate.compare_view(view, fields, self.settings.view_size, name, caption, truth.intensity))
        traced = self.work.seconds.get("trace", 0.0)
        return ReportData(
            scene=self.scene.name,
            field=choice.field,
            preset=choice.preset,
            seed=self.settings.seed,
            points=evaluate.compare_points(truth.points, baked, evaluate.object_names(self.scene)),
            views=views,
            **cost([graph]),
            seconds={"trace": round(traced, 3), "train": round(done["seconds"], 3)},
            paths=self.shared.paths,
            paths_per_second=self.shared.paths / max(traced, 1e-9),
            versions=versions(),
            settings=_settings_json(self.settings, self.variable, self.shared) | {"steps": done["steps"]},
            training=[(seconds, error) for seconds, error in done["curve"]],
            sweep=evaluate.light_sweep(truth.sweep, baked, unit),
            asset_bytes=size,
            warnings=warnings(self.scene, self.variable),
            facts=done["facts"],
            unit=unit,
        )

    def _write(self, out: Path, data: ReportData) -> dict[str, Any]:
        """The report and the page of one field; returns the report's numbers."""
        numbers = write_report(out, data).numbers
        write_page(
            out / "index.html",
            title=f"{self.scene.name}, {data.field} {data.preset}",
            glb=(out / "scene.glb").read_bytes(),
            home=self.truth.cameras[0][0],
            views=self.truth.pictures,
            exposure=self._exposure,
            report=numbers,
        )
        return numbers


def _facts(trained: Trained) -> dict[str, Any]:
    """What is kept of a training once its graph is written."""
    facts = facts_of(trained.fit)
    return {
        "seconds": trained.seconds,
        "steps": trained.steps,
        "cut": trained.cut,
        "curve": trained.curve,
        "facts": facts,
    }


def _settings_json(settings: CompareSettings, variable: Variable, shared: SharedSamples) -> dict[str, Any]:
    return {
        "scene": settings.scene,
        "variable": json.loads(json.dumps(asdict(variable))),
        "budget_seconds": settings.budget.seconds,
        "fixed_steps": settings.steps,
        "samples": len(shared.training),
        "paths_per_sample": settings.paths,
        "effort": asdict(shared.effort),
    }


# (key of a field in compare.json, heading, how it is printed).
COLUMNS = (
    ("name", "field", "{}"),
    ("relative_error", "error", "{:.2%}"),
    ("relative_error_median", "median", "{:.2%}"),
    ("relative_error_p95", "p95", "{:.2%}"),
    ("noise_floor", "noise", "{:.2%}"),
    ("psnr_db", "PSNR dB", "{:.2f}"),
    ("energy_ratio", "energy", "{:.3f}"),
    ("bytes", "bytes", "{:,}"),
    ("macs_per_pixel", "MAC/px", "{:,}"),
    ("fetches_per_pixel", "fetch/px", "{:,}"),
    ("train_seconds", "train s", "{:.1f}"),
)


def table(fields: Sequence[dict[str, Any]]) -> str:
    """The fields as aligned text, best first."""
    return aligned(sorted(fields, key=lambda field: field["relative_error"]), COLUMNS)
