"""The numbers of a comparison of fields: what compare.json holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lightwell.report.records import ReportData

# Version of compare.json.
VERSION = 1
# What a field's entry takes over from its report.json.
KEPT = (
    *("field", "preset", "relative_error", "relative_error_median", "relative_error_p95", "noise_floor", "rel_mse"),
    *("psnr_db", "ssim", "flip", "energy_ratio", "border_ratio", "bytes", "compressed_bytes", "asset_bytes"),
    *("parameters", "macs_per_pixel", "fetches_per_pixel", "training", "per_object", "per_view", "sweep", "facts"),
)
# What the comparison takes over from any report: it is the same for all fields.
SHARED = (
    "scene",
    "seed",
    "unit",
    "noise_floor",
    "points",
    "psnr_ceiling_db",
    "tone_mapping",
    "paths",
    "versions",
    "warnings",
)


@dataclass(frozen=True)
class ComparedField:
    """One finished field of a comparison."""

    name: str
    """``mlp:report-20``."""
    folder: str
    """Where its asset, page and report are, beside compare.html."""
    data: ReportData
    """What its pictures are made of."""
    numbers: Mapping[str, Any]
    """Its report.json."""
    steps: int
    """Training steps."""
    cut: bool = False
    """Whether its time ran out before the steps that were planned."""


def comparison_numbers(
    fields: Sequence[ComparedField], failed: Mapping[str, str], settings: Mapping[str, Any]
) -> dict[str, Any]:
    """The content of compare.json; ``failed`` is name → reason of the fields that are not there."""
    first = fields[0].numbers
    return {
        "version": VERSION,
        **{key: first[key] for key in SHARED},
        "trace_seconds": first["seconds"]["trace"],
        "fields": [_entry(field) for field in fields],
        "failed": dict(failed),
        "settings": dict(settings),
    }


def _entry(field: ComparedField) -> dict[str, Any]:
    own = {"name": field.name, "folder": field.folder, "steps": field.steps, "cut": field.cut}
    own["train_seconds"] = field.numbers["seconds"]["train"]
    own["segments"] = _segments(field.data)
    return own | {key: field.numbers[key] for key in KEPT}


def _segments(data: ReportData) -> int | None:
    """Number of experts that the views show; None for one network."""
    shown = [set(view.regions[view.regions >= 0].tolist()) for view in data.views if view.regions is not None]
    return len(set().union(*shown)) if shown else None
