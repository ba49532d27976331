"""Numbers of a comparison of fields: the content of compare.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lightwell.report.records import ReportData

# Version of compare.json.
VERSION = 1
# Keys of a field's report.json that its entry contains.
KEPT = (
    *("field", "preset", "relative_error", "relative_error_median", "relative_error_p95", "noise_floor", "rel_mse"),
    *("psnr_db", "ssim", "flip", "energy_ratio", "border_ratio", "bytes", "compressed_bytes", "asset_bytes"),
    *("parameters", "macs_per_pixel", "fetches_per_pixel", "training", "per_object", "per_view", "sweep", "facts"),
)
# Keys of report.json that are the same for all fields.
SHARED = (
    "scene",
    "seed",
    "unit",
    "noise_floor",
    "points",
    "sweep_axis",
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
    """For example ``mlp:report-20``."""
    folder: str
    """Folder of its asset, page and report, relative to compare.html."""
    data: ReportData
    """Predictions and references of its pictures."""
    numbers: Mapping[str, Any]
    """Content of its report.json."""
    steps: int
    """Training steps."""
    cut: bool = False
    """Whether the time limit ended training before the planned steps."""


def comparison_numbers(
    fields: Sequence[ComparedField], failed: Mapping[str, str], settings: Mapping[str, Any]
) -> dict[str, Any]:
    """Collect the content of compare.json.

    Args:
        fields: Fields that were baked, at least one.
        failed: Name → reason of the fields that failed.
        settings: Settings of the comparison; JSON values.

    Returns:
        JSON-serialisable data.
    """
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
    """Return the number of experts that the views show; None for one network."""
    shown = [set(view.regions[view.regions >= 0].tolist()) for view in data.views if view.regions is not None]
    return len(set().union(*shown)) if shown else None
