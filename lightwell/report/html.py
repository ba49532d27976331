"""Report of a bake: ``report.json`` with the numbers and ``report.html``, a self-contained page."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.files import make_folder, write_atomically
from lightwell.report import figures, sections
from lightwell.report.records import ReportData, ViewComparison
from lightwell.report.summary import summary


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
        folder: Folder to write to; created if missing.
        data: What was baked, with its references.

    Returns:
        Paths of the files, and the numbers.
    """
    numbers = summary(data)
    text = report_json(numbers)
    page = report_html(numbers, data)
    folder = make_folder(folder)
    written = WrittenReport(folder / "report.json", folder / "report.html", numbers)
    write_atomically(written.json, text)
    write_atomically(written.html, page)
    return written


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


def report_html(numbers: Mapping[str, Any], data: ReportData) -> str:
    """Build the page: pictures as data URIs, inline style and charts, no scripts.

    Args:
        numbers: Content of ``report.json``.
        data: What was baked, with its pictures.

    Returns:
        HTML.
    """
    pairs = zip(numbers["per_view"], data.views)
    views = [_view(i, scores, view, numbers["unit"]) for i, (scores, view) in enumerate(pairs)]
    parts = [
        sections.masthead(numbers),
        sections.headline(numbers),
        sections.warnings(numbers["warnings"]),
        _views(views),
        sections.curves(numbers),
        sections.about_the_field(numbers),
        sections.tables(numbers),
        sections.terms(numbers),
        sections.provenance(numbers),
        f"<footer>Written by lightwell {escape(str(numbers['versions'].get('lightwell', '')))}. "
        "The same numbers are in report.json beside this file.</footer>",
    ]
    return page(f"{numbers['scene']} · lightwell", parts)


def page(title: str, parts: Sequence[str], style: str = "") -> str:
    """Build a self-contained page.

    Args:
        title: Title; escaped.
        parts: Sections, HTML.
        style: CSS added to that of the template.

    Returns:
        HTML.
    """
    template = resources.files("lightwell.report").joinpath("template.html").read_text("utf-8")
    before, after = template.split("{{body}}")
    before = before.replace("{{title}}", escape(title)).replace("/*style*/", style)
    return before + "\n".join(parts) + after


def _view(number: int, scores: Mapping[str, Any], view: ViewComparison, unit: float) -> str:
    f, y = np.asarray(view.prediction, np.float64) / unit, view.reference / unit
    pictures = figures.view_pictures(f, y, view.regions, view.blend)
    return sections.view(number, scores, pictures, figures.worst_tile_pictures(f, y))


def _views(views: list[str]) -> str:
    if not views:
        return ""
    about = "Indirect light in held-out views under held-out lights, with the same exposure."
    return f'<h2>Learned and path-traced light</h2><p class="soft">{about}</p>{"".join(views)}'
