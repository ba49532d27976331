"""The comparison of fields: ``compare.json`` for machines, ``compare.html`` for people, one file that can be mailed."""

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
    """Write ``compare.json`` and ``compare.html``; returns the numbers. Each file appears whole or not at all."""
    numbers = comparison_numbers(fields, failed, settings)
    text, html = report_json(numbers), comparison_html(numbers, fields)
    folder = make_folder(folder)
    write_atomically(folder / "compare.json", text)
    write_atomically(folder / "compare.html", html)
    return numbers


def comparison_html(numbers: Mapping[str, Any], fields: Sequence[ComparedField]) -> str:
    """The self-contained page. A picture is stored once, as the background of a class, however often it is shown."""
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
    """A class for every picture: ``reference-VIEW``, ``prediction-FIELD-VIEW``, ``difference-…``, ``regions-…``."""
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
