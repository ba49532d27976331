"""Comparison of several fields on the same samples, scored against the same reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from lightwell.baking.evaluate import Shipped
from lightwell.baking.late_notes import LateNotes
from lightwell.baking.pipeline import (
    PAGE,
    attempt_exposure,
    loaded,
    shown_lights,
    write_asset,
    write_report_and_page,
)
from lightwell.baking.reference import Reference, trace_reference
from lightwell.baking.reference_budget import ReferenceBudget
from lightwell.baking.refusals import refuse_declared, refuse_sky
from lightwell.baking.score import reference_budget, score, variable_json
from lightwell.baking.settings import Compared, field_options, request_of
from lightwell.baking.side_by_side import aligned
from lightwell.cluster.attach import attached
from lightwell.core.options import check
from lightwell.core.output import BAKE_FILES, COMPARE_FILES, holds_output
from lightwell.core.progress import Progress
from lightwell.core.work import Work
from lightwell.fields.protocol import Field, Fit, Job, Role, State
from lightwell.fields.registry import field_names, find_field, preset_of
from lightwell.fields.request import Request
from lightwell.report.compare_html import ComparedField, write_comparison
from lightwell.report.records import PageLink

ROLE: Role = "indirect"


@dataclass(frozen=True)
class FieldChoice:
    """A field and one of its presets."""

    field: str
    preset: str

    @property
    def name(self) -> str:
        """Name in a comparison: ``mlp`` for the default preset, else ``mlp:report-20``."""
        default = next(iter(find_field(self.field).presets))
        return self.field if self.preset == default else f"{self.field}:{self.preset}"

    @property
    def folder(self) -> str:
        """Name of its folder."""
        return self.name.replace(":", "-")


def parse_fields(text: str) -> tuple[FieldChoice, ...]:
    """Read a list of fields from text.

    Args:
        text: Names like ``mlp,mlp:report-20,factored``; a field without a preset has its default one.

    Returns:
        The fields, each once.

    Raises:
        ValueError: The text names no field.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    if not words:
        raise ValueError(f"compare: --fields '{text}' names no field; choose some of {', '.join(field_names())}")
    return tuple(dict.fromkeys(_choice(word) for word in words))


def _choice(word: str) -> FieldChoice:
    field, _, preset = word.partition(":")
    if field not in field_names():
        raise ValueError(f"compare: unknown field '{field}' in --fields; choose some of {', '.join(field_names())}")
    known = find_field(field).presets
    if preset and preset not in known:
        names = ", ".join(f"{field}:{name}" for name in known)
        raise ValueError(f"compare: field '{field}' has no preset '{preset}'; choose some of {names}")
    return FieldChoice(field, preset or next(iter(known)))


@dataclass(frozen=True)
class CompareSettings(Compared):
    """Settings of a comparison. ``budget`` is that of each field in a bake: half of it traces the samples, once, and
    half trains each field. ``preset`` and ``static`` are not used: every field has a preset of its own, and only the
    variable light is compared."""

    scene: str
    """Path of a scene or the name of a built-in one."""
    out: Path
    """Folder to write."""
    fields: tuple[FieldChoice, ...]

    def __post_init__(self) -> None:
        """Refuse values without meaning, by the name of their option."""
        super().__post_init__()
        if self.budget.seconds is None:
            raise ValueError("compare: --budget must be a time such as 60s; an error cannot be the same for all fields")
        if self.truth and self.truth.seconds is None:
            raise ValueError("compare: --truth must be a time such as 5m")
        check(self, "compare")


def _files(settings: CompareSettings) -> list[str]:
    return [*COMPARE_FILES, *(f"{choice.folder}/{name}" for choice in settings.fields for name in BAKE_FILES)]


@holds_output("compare", _files)
def compare_fields(settings: CompareSettings, progress: Progress | None = None) -> dict[str, Any]:
    """Trace once, train every field, and score all of them.

    A field that cannot be trained is left out and listed under ``failed``.

    Args:
        settings: Settings of the comparison.
        progress: Bars and lines on standard error; None: no output.

    Returns:
        The content of ``compare.json``.

    Raises:
        ValueError: A mistake of the user: one line with the cure; or no field could be trained.
        RuntimeError: The only field failed in Mitsuba or Dr.Jit.
        ArithmeticError: The only field failed in a computation.
    """
    progress = progress or Progress(quiet=True)
    scene = loaded(settings)
    work = Work(settings, scene.digest)
    each = _Comparison(settings, work, progress, scene)
    compared, failed = [], {}
    with attached(scene, settings.loading, settings, progress.say):
        for choice in settings.fields:
            try:
                compared.append(each.field(choice))
            except (ValueError, RuntimeError, ArithmeticError) as error:
                if each.reference is None and len(settings.fields) == 1:
                    raise
                failed[choice.name] = " ".join(str(error).split()) or type(error).__name__
                progress.say(f"[yellow]{choice.name} failed:[/] {failed[choice.name]}")
    if not compared:
        raise ValueError(f"compare: no field could be trained ({'; '.join(failed.values())})")
    told = {name: value for name, value in compared[0].data.settings.items() if name != "steps"}
    numbers = write_comparison(settings.out, compared, failed, told)
    work.close()
    first = settings.out / numbers["fields"][0]["folder"]
    progress.say(f"{settings.out / 'compare.html'}  open a field with: lightwell view {first}")
    return numbers


class _Comparison:
    """Samples and reference that all fields of a comparison share."""

    def __init__(self, settings: CompareSettings, work: Work, progress: Progress, scene: Any) -> None:
        self.settings, self.work, self.progress, self.scene = settings, work, progress, scene
        self.reference: Reference | None = None
        self.notes = LateNotes(progress)
        self._budget: ReferenceBudget | None = None
        self._exposure: float | None = None
        # Samples by ``Field.shares``.
        self._samples: dict[str, Any] = {}

    def field(self, choice: FieldChoice) -> ComparedField:
        """Train, lower, score and write one field; the checkpoint of one that is finished is read."""
        field, out = find_field(choice.field), self.settings.out / choice.folder
        preset = preset_of(choice.field, choice.preset, self.settings.quality)
        request = replace(Request(**request_of(self.settings)), preset=preset)
        options = field_options(choice.field, {}, "compare")
        job = Job(self.scene, request, options, self.work, self.progress, shared=True)
        refuse_declared(choice.field, field, job)
        state = field.prepare(job)
        refuse_sky(choice.field, field, state)
        fit = self._fit(field, state, choice)
        shipped = Shipped.of(ROLE, fit, fit.lower())
        reference = self._traced(state, fit)
        traced = self.work.seconds.get("trace", 0.0)
        seconds = {"trace": traced, "train": fit.training.seconds}
        data = score(
            state,
            self.settings,
            choice.field,
            [shipped],
            reference,
            seconds,
            self._told(state, fit),
            self._budget,
            self.notes,
        )
        data = replace(data, paths_per_second=fit.traced.paths / max(traced, 1e-9))
        out.mkdir(exist_ok=True)
        stage = reference.stage
        size = write_asset(out, state, [shipped], shown_lights(state, stage), self._exposure)
        links = (PAGE, PageLink("../compare.html", "all fields compared"))
        data = replace(data, asset_bytes=size, links=links)
        numbers = write_report_and_page(out, state, data, reference, self.notes, self._exposure)
        return ComparedField(choice.name, choice.folder, data, numbers, fit.training.steps, fit.training.cut)

    def _fit(self, field: Field, state: State, choice: FieldChoice) -> Fit:
        if field.shares not in self._samples:
            self._samples[field.shares] = field.sample(state, ROLE)
        part = self.work.part(role=ROLE, field=choice.name)
        return field.fit(state, ROLE, self._samples[field.shares], part)

    def _traced(self, state: State, fit: Fit) -> Reference:
        """The reference, traced after the first fit, because its budget and unit are known only then."""
        if self.reference is None:
            self._budget = reference_budget(self.settings, state.job, fit)
            with self.work.timed("evaluate"):
                self.reference = trace_reference(
                    state.scene,
                    state.variable,
                    [ROLE],
                    {ROLE: fit.unit},
                    self.settings,
                    self._budget,
                    self.notes,
                    self.progress,
                    self.work.store,
                )
                self._exposure = attempt_exposure(state, self.reference.stage, self.settings, self.notes)
        return self.reference

    def _told(self, state: State, fit: Fit) -> dict[str, Any]:
        """Settings as they are written to the report."""
        settings = self.settings
        return {
            "scene": settings.scene,
            "variable": variable_json(state.variable),
            "quality": settings.quality,
            "budget_seconds": settings.budget.seconds,
            "fixed_steps": settings.steps,
            "samples": fit.traced.samples,
            "paths_per_sample": fit.traced.each or settings.paths,
            "effort": asdict(self._budget),
            "steps": fit.training.steps,
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
    """Format the fields of a comparison as text, the least error first.

    Args:
        fields: Fields as in ``compare.json``.

    Returns:
        Aligned lines.
    """
    return aligned(sorted(fields, key=lambda field: field["relative_error"]), COLUMNS)
