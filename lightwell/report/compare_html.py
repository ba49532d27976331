"""Comparison of fields: ``compare.json`` with the numbers and ``compare.html``, a self-contained page."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.files import make_folder, write_atomically
from lightwell.report import compare_sections as sections
from lightwell.report import figures
from lightwell.report.comparison import ComparedField as ComparedField
from lightwell.report.comparison import comparison_numbers
from lightwell.report.html import page, report_json
from lightwell.report.sections import provenance, warnings


def write_comparison(
    folder: str | Path, fields: Sequence[ComparedField], failed: Mapping[str, str], settings: Mapping[str, Any]
) -> dict[str, Any]:
    """Write ``compare.json`` and ``compare.html``; each file is either complete or absent.

    Args:
        folder: Folder to write to; created if missing.
        fields: Fields that were baked, at least one.
        failed: Name → reason of the fields that failed.
        settings: Settings of the comparison; JSON values.

    Returns:
        Content of ``compare.json``. A number that is NaN or infinite raises ``ValueError`` and nothing is written.
    """
    numbers = comparison_numbers(fields, failed, settings)
    text, html = report_json(numbers), comparison_html(numbers, fields)
    folder = make_folder(folder)
    write_atomically(folder / "compare.json", text)
    write_atomically(folder / "compare.html", html)
    return numbers


def comparison_html(numbers: Mapping[str, Any], fields: Sequence[ComparedField]) -> str:
    """Build the page; each picture is stored once, as the background of a CSS class.

    Args:
        numbers: Content of ``compare.json``.
        fields: Fields that were baked, with their pictures.

    Returns:
        HTML.
    """
    limits = [*numbers["warnings"], *(f"{name} failed: {reason}" for name, reason in numbers["failed"].items())]
    parts = [
        sections.masthead(numbers),
        warnings(limits, "Limits of this comparison"),
        sections.fields_table(numbers),
        sections.cost_charts(numbers),
        sections.contact_sheet(numbers),
        sections.panels(numbers),
        sections.where(numbers),
        sections.terms(numbers),
        provenance({"licences": [], **numbers}),
        f"<footer>Written by lightwell {escape(str(numbers['versions'].get('lightwell', '')))}. "
        "The same numbers are in compare.json beside this file, and every field has a folder there.</footer>",
    ]
    return page(f"{numbers['scene']}, fields compared · lightwell", parts, _picture_styles(fields, numbers["unit"]))


def _picture_styles(fields: Sequence[ComparedField], unit: float) -> str:
    """Return a class per picture: ``reference-VIEW``, ``prediction-FIELD-VIEW``, ``difference-…``, ``regions-…``."""
    rules = []
    for k, field in enumerate(fields):
        for v, view in enumerate(field.data.views):
            f, y = np.asarray(view.prediction, np.float64) / unit, view.reference / unit
            if k == 0:
                rules.append(_rule(f"reference-{v}", figures.shown(y)))
                height, width = y.shape[:2]
                rules.append(f":root {{ --aspect: {width} / {height}; }}")
            rules.append(_rule(f"prediction-{k}-{v}", figures.shown(f)))
            rules.append(_rule(f"difference-{k}-{v}", figures.difference(f, y)))
            if view.regions is not None:
                rules.append(_rule(f"regions-{k}-{v}", figures.region_colours(view.regions, view.blend)))
    return "\n".join(rules)


def _rule(name: str, pixels: np.ndarray) -> str:
    data = base64.b64encode(figures.png(pixels)).decode()
    return f".{name} {{ background-image: url(data:image/png;base64,{data}); }}"
