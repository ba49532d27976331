"""Report of a bake: ``report.json`` with the numbers and ``report.html``, a self-contained page."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lightwell.files import make_folder, write_atomically
from lightwell.report import charts, figures
from lightwell.report.cards import COMPARED, cards
from lightwell.report.charts import ChartAxis, ChartSeries
from lightwell.report.facts import facts_of
from lightwell.report.numbers import brief_duration, brief_percent, digits, grouped, percent
from lightwell.report.pages import TEMPLATES
from lightwell.report.records import MovedObject, ReportData, ViewComparison
from lightwell.report.states import DRAWN, state_charts
from lightwell.report.summary import summary, view_unit

# The pictures of the first view, in templates/report.html.
FIRST_VIEW = re.compile(r'<img id="first-(learned|reference)"[^>]* src="(data:[^"]+)"')
# Largest number of objects in the bar chart; the table has all of them.
MAX_BARS = 16


@dataclass(frozen=True)
class WrittenReport:
    """Files and numbers of a report."""

    json: Path
    html: Path
    numbers: dict[str, Any]
    """The content of ``report.json``."""


def write_report(folder: str | Path, data: ReportData) -> WrittenReport:
    """Score a bake and write ``report.json`` and ``report.html``.

    NaN or infinity in anything that is scored or reported raises ``ValueError``; nothing is written then.

    Args:
        folder: Folder to write to; created if missing. The figures of a report of the same scene that it already holds
            are shown beside the new ones.
        data: What was baked, with its references.

    Returns:
        Paths of the files, and the numbers.
    """
    folder = Path(folder)
    numbers = summary(data) | {"previous": previous_figures(folder / "report.json", data.scene)}
    text = report_json(numbers)
    page = report_html(numbers, data)
    make_folder(folder)
    written = WrittenReport(folder / "report.json", folder / "report.html", numbers)
    write_atomically(written.json, text)
    write_atomically(written.html, page)
    return written


def previous_figures(path: Path, scene: str) -> dict[str, Any] | None:
    """Read the main figures of an earlier report.

    Args:
        path: Its ``report.json``.
        scene: Scene that it must be of.

    Returns:
        The figures; None where there is no report, or it is of another scene or version.
    """
    try:
        found = json.loads(path.read_text("utf-8"))
        return {key: found[key] for key in COMPARED} if found["scene"] == scene else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def report_json(numbers: Mapping[str, Any]) -> str:
    """Encode numbers as JSON text.

    Args:
        numbers: JSON values.

    Returns:
        The text.

    Raises:
        ValueError: A number is NaN or infinite.
        TypeError: A value is not a JSON value.
    """
    try:
        return json.dumps(numbers, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    except ValueError as error:
        raise ValueError("report: a number is NaN or infinite; nothing is written") from error
    except TypeError as error:
        raise TypeError(f"report: settings and versions must be plain JSON values ({error})") from error


def first_pictures(path: Path) -> dict[str, str]:
    """Read learned light and reference of the first view from a report.

    Args:
        path: ``report.html``.

    Returns:
        "learned" and "reference" → data URI; nothing where there is no report or no view in it.
    """
    try:
        found = FIRST_VIEW.findall(path.read_text("utf-8"))
    except OSError:
        return {}
    return dict(found)


def report_html(numbers: Mapping[str, Any], data: ReportData) -> str:
    """Build the page: pictures as data URIs, inline style and charts, no scripts.

    Args:
        numbers: Content of ``report.json``.
        data: What was baked, with its pictures.

    Returns:
        HTML.
    """
    scored = list(zip(numbers["per_view"], data.views))
    return TEMPLATES.render(
        "report.html",
        numbers=numbers,
        level=data.verdict.level if data.verdict else "",
        links=data.links,
        cards=cards(numbers),
        places=[_place(place, data.views) for place in numbers["worst_places"]],
        views=[{"scores": s, "pictures": figures.view_pictures(v, s["exposure_unit"])} for s, v in scored],
        balls=[_ball(ball, numbers["moved_objects"]["flips"][ball.name]) for ball in data.moved],
        balls_flip=digits(numbers["moved_objects"]["flip"]) if data.moved else "",
        enlarged=max((figures.magnification(view) for view in data.views), default=1),
        charts=_charts(numbers, data.views),
        facts=facts_of({name: fact for name, fact in numbers["facts"].items() if name not in DRAWN}),
        view_rows=[_view_row(view) for view in numbers["per_view"]],
        object_rows=[_object_row(row) for row in numbers["per_object"]],
        inferno=figures.INFERNO,
    )


def _place(place: Mapping[str, Any], views: Sequence[ViewComparison]) -> dict[str, Any]:
    """Title, text and pictures of one of the worst places."""
    view = views[place["view"]]
    title = place["object"] or view.name
    where = view.name
    if place["position"]:
        where += ", at ({:.2f}, {:.2f}, {:.2f}) m".format(*place["position"])
    ratio = place["energy_ratio"]
    told = ""
    if ratio is not None and abs(ratio - 1) >= 0.005:
        told = f"{percent(abs(ratio - 1))} too {'bright' if ratio > 1 else 'dark'} on average, "
    return {
        "size": place["size"],
        "title": title,
        "text": f"{told}{digits(place['psnr_db'])} dB; {where}.",
        "pictures": figures.place_pictures(view, view_unit(view), place["row"], place["column"], place["size"]),
    }


def _ball(ball: MovedObject, flip: float) -> dict[str, Any]:
    """Name, error and pictures of what probes light."""
    pictures = {"prediction": ball.prediction, "reference": ball.reference}
    encoded = {
        key: figures.data_uri(figures.shown(value / ball.unit), lossless=True) for key, value in pictures.items()
    }
    return {"title": ball.name, "flip": digits(flip), "pictures": encoded}


def _charts(numbers: Mapping[str, Any], views: Sequence[ViewComparison]) -> list[dict[str, Any]]:
    """Charts of training, of what varies, and of the objects; those without data have no picture."""
    rows = sorted(numbers["per_object"], key=lambda row: -row["relative_error"])[:MAX_BARS]
    bars = [(row["name"], row["relative_error"], row["noise_floor"]) for row in rows]
    return [
        {"svg": _training_chart(numbers), "caption": "Error on validation samples while training."},
        *state_charts(numbers, views),
        {
            "svg": charts.bar_chart(bars, percent, "Error by object"),
            "caption": "Error by object, worst first; the thin mark is the noise floor.",
        },
    ]


def _training_chart(numbers: Mapping[str, Any]) -> str:
    xs, ys = ([point[key] for point in numbers["training"]] for key in ("seconds", "relative_error"))
    if not xs:
        return ""
    lines = [ChartSeries("validation error", xs, ys)]
    if numbers["noise_floor"] is not None:
        lines.append(ChartSeries("noise floor", [min(xs), max(xs)], [numbers["noise_floor"]] * 2, dashed=True))
    x = ChartAxis("training time", brief_duration, log=True)
    return charts.line_chart(lines, x, ChartAxis("relative error", brief_percent, log=True), "Error while training")


def _view_row(view: Mapping[str, Any]) -> tuple[str, ...]:
    error = percent(view["relative_error"]), percent(view["noise_floor"])
    ssim, flip, energy = f"{view['ssim']:.4f}", digits(view["flip"]), digits(view["energy_ratio"], 4)
    return view["name"], *error, digits(view["psnr_db"]), ssim, flip, energy


def _object_row(row: Mapping[str, Any]) -> tuple[str, ...]:
    error = percent(row["relative_error"]), percent(row["noise_floor"])
    return row["name"], grouped(row["points"]), *error, digits(row["energy_ratio"], 4)
