"""Numbers of a report: the content of report.json."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from lightwell.report import metrics, picture_metrics
from lightwell.report.borders import border_error
from lightwell.report.picture_metrics import TILE, TileError, flip_of_part
from lightwell.report.records import MovedObject, PointComparison, ReportData, ViewComparison

# Version of report.json.
VERSION = 2
TONE_MAPPING = (
    "x / (1 + x), then sRGB, of radiance over the exposure unit of the view: 4 × the mean of the reference there, "
    "without black pixels and with highlights clamped to the 99th percentile"
)
# Places that are named and shown; in one view at most so many.
WORST_PLACES, WORST_IN_A_VIEW = 4, 2


def summary(data: ReportData) -> dict[str, Any]:
    """Compute every number of a report.

    Args:
        data: What was baked, with its references. NaN or infinity in it raises ``ValueError``.

    Returns:
        JSON-serialisable data; radiance is relative to the unit S, in displayed pictures to the exposure unit of the
        view.
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
        "worst_places": worst_places(data.views),
        "moved_objects": moved_scores(data.moved),
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
        "sweep_axis": data.sweep_axis,
        "sweep": [{"at": t, "relative_error": e, "noise_floor": n} for t, e, n in data.sweep],
        "facts": data.facts,
        "settings": data.settings,
        "versions": data.versions,
        "warnings": list(data.warnings),
        "licences": list(data.licences),
    }


def moved_scores(moved: Sequence[MovedObject]) -> dict[str, Any] | None:
    """Score the pictures of what probes light.

    Args:
        moved: The pictures.

    Returns:
        Mean FLIP over them, that of the worst, and each by name; None where there are none.
    """
    shown = [(ball, ball.prediction / ball.unit, ball.reference / ball.unit) for ball in moved]
    flips = {ball.name: flip_of_part(f, y, ball.mask) for ball, f, y in shown}
    if not flips:
        return None
    values = list(flips.values())
    return {"flip": float(np.mean(values)), "worst": max(values), "flips": flips}


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
        "error_without_noise": metrics.error_without_noise(f, a, b, weight),
        "energy_ratio": metrics.energy_ratio(f, y, weight),
        "points": len(f),
        "per_object": metrics.per_object(f, a, b, np.asarray(points.shape), points.objects, weight),
    }


def _no_scores() -> dict[str, Any]:
    """Entries of report.json where the held-out points could not be scored."""
    errors = ("relative_error", "relative_error_median", "relative_error_p95", "noise_floor", "rel_mse")
    names = (*errors, "error_without_noise", "energy_ratio")
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
    exposure = view_unit(view)
    shown_f, shown_a, shown_b, shown_y = (x * (scale / exposure) for x in (f, a, b, y))
    return {
        "name": view.name,
        "caption": view.caption,
        "width": f.shape[1],
        "height": f.shape[0],
        "relative_error": metrics.relative_error(f, y).mean,
        "noise_floor": metrics.noise_floor(a, b).mean,
        "exposure_unit": exposure,
        "psnr_db": picture_metrics.psnr_db(shown_f, shown_y),
        "psnr_ceiling_db": picture_metrics.psnr_ceiling_db(shown_a, shown_b),
        "ssim": picture_metrics.ssim(shown_f, shown_y),
        "flip": picture_metrics.flip(shown_f, shown_y),
        "energy_ratio": metrics.energy_ratio(f, y),
        "border": _border(view, f, y),
    }


def view_unit(view: ViewComparison) -> float:
    """Compute the exposure unit of a view, from its reference.

    Args:
        view: The picture.

    Returns:
        The unit, in that of the picture; 1 where the reference is black.
    """
    return picture_metrics.exposure_unit(view.reference) or 1.0


def worst_places(views: Sequence[ViewComparison]) -> list[dict[str, Any]]:
    """Find the tiles of all views with the largest noise-free error of display values.

    Args:
        views: The pictures.

    Returns:
        Worst first: view (index), row, column, size in pixels, PSNR of the tile, learned over reference light, and the
        object and position in metres where they are known.
    """
    found = []
    for k, view in enumerate(views):
        unit = view_unit(view)
        f, a, b = (np.asarray(x, np.float64) / unit for x in (view.prediction, view.half_a, view.half_b))
        found += [(k, tile) for tile in _apart(picture_metrics.tile_errors(f, a, b))]
    found.sort(key=lambda item: -item[1].error)
    return [_place(k, views[k], tile) for k, tile in found[:WORST_PLACES]]


def _apart(tiles: Iterable[TileError]) -> list[TileError]:
    """The worst tiles of a view that do not touch each other."""
    chosen: list[TileError] = []
    for tile in sorted(tiles, key=lambda tile: -tile.error):
        near = [max(abs(tile.row - other.row), abs(tile.column - other.column)) <= TILE for other in chosen]
        if tile.error > 0 and not any(near) and len(chosen) < WORST_IN_A_VIEW:
            chosen.append(tile)
    return chosen


def _place(number: int, view: ViewComparison, tile: TileError) -> dict[str, Any]:
    window = np.s_[tile.row : tile.row + TILE, tile.column : tile.column + TILE]
    light = [float(np.asarray(x, np.float64)[window].mean()) for x in (view.prediction, view.reference)]
    place: dict[str, Any] = {
        "view": number,
        "row": tile.row,
        "column": tile.column,
        "size": TILE,
        "psnr_db": -10 * float(np.log10(tile.error)),
        "energy_ratio": light[0] / light[1] if light[1] > 0 else None,
        "object": None,
        "position": None,
    }
    if view.surfaces is None:
        return place
    shape = view.surfaces.shape[window]
    seen = shape[shape >= 0]
    if seen.size:
        most = int(np.bincount(seen).argmax())
        middle = np.median(view.surfaces.position[window][shape == most], axis=0)
        place |= {"object": view.surfaces.objects[most], "position": [round(float(x), 3) for x in middle]}
    return place


def _border(view: ViewComparison, f: np.ndarray, y: np.ndarray) -> dict[str, float] | None:
    """Return errors near and away from the borders between regions, None where there are none."""
    if view.regions is None:
        return None
    found = border_error(f, y, np.asarray(view.regions))
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
