"""Numbers of a report: the content of report.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lightwell.report import metrics
from lightwell.report.records import PointComparison, ReportData, ViewComparison

# Version of report.json.
VERSION = 1
TONE_MAPPING = "x / (1 + x) of radiance in the unit S, then sRGB"


def summary(data: ReportData) -> dict[str, Any]:
    """Compute every number of a report.

    Args:
        data: What was baked, with its references. NaN or infinity in it raises ``ValueError``.

    Returns:
        JSON-serialisable data; radiance is relative to the unit S.
    """
    scale = data.unit
    if scale is None:
        scale = 1.0 if data.points is None else reference_unit(data.points)
    views = [view_scores(view, scale) for view in data.views]
    return {
        "version": VERSION,
        "scene": data.scene,
        "field": data.field,
        "preset": data.preset,
        "seed": data.seed,
        "unit": scale,
        **(_no_scores() if data.points is None else point_scores(data.points, scale)),
        **{name: _mean(views, name) for name in ("psnr_db", "psnr_ceiling_db", "ssim", "flip")},
        "quality": data.quality,
        "verdict": None if data.verdict is None else data.verdict.text,
        "border_ratio": border_ratio(views),
        "tone_mapping": TONE_MAPPING,
        "bytes": data.bytes,
        "asset_bytes": data.asset_bytes,
        "compressed_bytes": data.compressed_bytes,
        "parameters": data.parameters,
        "macs_per_pixel": data.macs_per_pixel,
        "fetches_per_pixel": data.fetches_per_pixel,
        "seconds": {**data.seconds, "total": sum(t for stage, t in data.seconds.items() if stage != "total")},
        "paths": data.paths,
        "paths_per_second": data.paths_per_second,
        "per_view": views,
        "training": [{"seconds": s, "relative_error": e} for s, e in data.training],
        "sweep": [{"at": t, "relative_error": e, "noise_floor": n} for t, e, n in data.sweep],
        "facts": data.facts,
        "settings": data.settings,
        "versions": data.versions,
        "warnings": list(data.warnings),
        "licences": list(data.licences),
    }


def reference_unit(points: PointComparison) -> float:
    """Compute the unit S of held-out points: 4 × their mean reference radiance.

    Args:
        points: The points.

    Returns:
        S, in the unit of the points.
    """
    return metrics.unit(0.5 * (np.asarray(points.half_a, np.float64) + points.half_b), points.weight)


def point_scores(points: PointComparison, scale: float) -> dict[str, Any]:
    """Compute errors over the held-out points, for all and by object.

    Args:
        points: The points.
        scale: The unit S.

    Returns:
        Entries of report.json.
    """
    f, a, b = (np.asarray(x, np.float64) / scale for x in (points.prediction, points.half_a, points.half_b))
    y, weight = 0.5 * (a + b), points.weight
    error, floor = metrics.relative_error(f, y, weight), metrics.noise_floor(a, b, weight)
    return {
        "relative_error": error.mean,
        "relative_error_median": error.median,
        "relative_error_p95": error.p95,
        "noise_floor": floor.mean,
        "rel_mse": metrics.rel_mse(f, a, b, weight),
        "energy_ratio": metrics.energy_ratio(f, y, weight),
        "points": len(f),
        "per_object": metrics.per_object(f, a, b, np.asarray(points.shape), points.objects, weight),
    }


def _no_scores() -> dict[str, Any]:
    """Entries of report.json where the held-out points could not be scored."""
    names = ("relative_error", "relative_error_median", "relative_error_p95", "noise_floor", "rel_mse", "energy_ratio")
    return {**dict.fromkeys(names), "points": 0, "per_object": []}


def view_scores(view: ViewComparison, scale: float) -> dict[str, Any]:
    """Compute the scores of one picture.

    Args:
        view: The picture.
        scale: The unit S.

    Returns:
        An entry of ``per_view``.
    """
    f, a, b = (np.asarray(x, np.float64) / scale for x in (view.prediction, view.half_a, view.half_b))
    y = 0.5 * (a + b)
    row, column, worst = metrics.worst_tile(f, y)
    return {
        "name": view.name,
        "caption": view.caption,
        "width": f.shape[1],
        "height": f.shape[0],
        "relative_error": metrics.relative_error(f, y).mean,
        "noise_floor": metrics.noise_floor(a, b).mean,
        "psnr_db": metrics.psnr_db(f, y),
        "psnr_ceiling_db": metrics.psnr_ceiling_db(a, b),
        "ssim": metrics.ssim(f, y),
        "flip": metrics.flip(f, y),
        "energy_ratio": metrics.energy_ratio(f, y),
        "worst_tile": {"row": row, "column": column, "relative_error": worst},
        "border": _border(view, f, y),
    }


def _border(view: ViewComparison, f: np.ndarray, y: np.ndarray) -> dict[str, float] | None:
    """Return errors near and away from the borders between regions, None where there are none."""
    if view.regions is None:
        return None
    found = metrics.border_error(f, y, np.asarray(view.regions))
    return None if found is None else {"border": found.border, "interior": found.interior, "share": found.share}


def border_ratio(views: Sequence[Mapping[str, Any]]) -> float | None:
    """Compute mean border error over mean interior error of all views that have borders.

    Args:
        views: Entries of ``per_view``.

    Returns:
        The ratio; None when no view has borders.
    """
    pairs = [view["border"] for view in views if view["border"]]
    if not pairs:
        return None
    border = np.average([pair["border"] for pair in pairs], weights=[pair["share"] for pair in pairs])
    return float(border / np.average([p["interior"] for p in pairs], weights=[1 - p["share"] for p in pairs]))


def _mean(views: list[dict[str, Any]], name: str) -> float | None:
    """Return the mean over the views, None when there is none."""
    return float(np.mean([view[name] for view in views])) if views else None
