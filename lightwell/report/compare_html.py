"""Comparison of fields: ``compare.json`` with the numbers and ``compare.html``, a self-contained page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.files import make_folder, write_atomically
from lightwell.report import charts, figures
from lightwell.report.charts import ChartAxis, ChartSeries
from lightwell.report.comparison import ComparedField as ComparedField
from lightwell.report.comparison import comparison_numbers
from lightwell.report.facts import TONES, facts_of
from lightwell.report.html import report_json
from lightwell.report.numbers import (
    amount,
    brief,
    brief_amount,
    brief_duration,
    brief_percent,
    digits,
    duration,
    grouped,
    percent,
)
from lightwell.report.pages import TEMPLATES
from lightwell.report.scatter import MARKERS, ScatterPoint, scatter_chart
from lightwell.report.summary import view_unit

# Highlighted: an object whose error is above this multiple of the field's mean, and a seam above this ratio.
HIGH_OBJECT, HIGH_BORDER = 3, 1.2
# Largest number of objects in the table of errors by object.
MOST_OBJECTS = 24

Numbers = Mapping[str, Any]

# Heading; key; formatting; whether small (-1) or large (1) values are better, 0: neither.
COLUMNS = (
    ("Error", "relative_error", percent, -1),
    ("Median", "relative_error_median", percent, -1),
    ("95\u202f% below", "relative_error_p95", percent, -1),
    ("Noise floor", "noise_floor", percent, 0),
    ("PSNR, dB", "psnr_db", digits, 1),
    ("SSIM", "ssim", lambda v: f"{v:.4f}", 1),
    ("FLIP", "flip", digits, -1),
    ("Energy", "energy_ratio", lambda v: f"{v:.3f}", 0),
    ("Border / interior", "border_ratio", lambda v: f"{v:.2f}", 0),
    ("Bytes", "bytes", lambda v: amount(v, "B"), -1),
    ("zlib", "compressed_bytes", lambda v: amount(v, "B"), -1),
    ("Parameters", "parameters", grouped, -1),
    ("MAC / pixel", "macs_per_pixel", grouped, -1),
    ("Fetches / pixel", "fetches_per_pixel", grouped, 0),
    ("Training", "train_seconds", duration, 0),
)


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
    home = make_folder(folder)
    write_atomically(home / "compare.json", text)
    write_atomically(home / "compare.html", html)
    return numbers


def comparison_html(numbers: Numbers, fields: Sequence[ComparedField]) -> str:
    """Build the page; each picture is stored once, as the background of a CSS class.

    Args:
        numbers: Content of ``compare.json``.
        fields: Fields that were baked, with their pictures.

    Returns:
        HTML.
    """
    ranked = sorted(_fields(numbers), key=lambda field: field["relative_error"])
    by_object = sorted(range(len(ranked[0]["per_object"])), key=lambda k: -ranked[0]["per_object"][k]["relative_error"])
    shown = next((view.half_a.shape for view in fields[0].data.views), None)
    return TEMPLATES.render(
        "compare.html",
        numbers={"licences": [], **numbers},
        limits=[*numbers["warnings"], *(f"{name} failed: {reason}" for name, reason in numbers["failed"].items())],
        fields=ranked,
        columns=[heading for heading, *_ in COLUMNS],
        charts=_charts(numbers),
        rules=list(_rules(fields)),
        aspect=f"{shown[1]} / {shown[0]}" if shown else "",
        seams=[_seam(field) for field in ranked if field["border_ratio"] is not None],
        objects=[_object_row(ranked, k) for k in by_object[:MOST_OBJECTS]],
        objects_left_out=max(len(by_object) - MOST_OBJECTS, 0),
        high_object=HIGH_OBJECT,
        inferno=figures.INFERNO,
    )


def _fields(numbers: Numbers) -> Iterator[dict[str, Any]]:
    """The fields with what the page adds to their numbers: colour, cells of the table, facts."""
    best = {}
    for _, key, _, sign in COLUMNS:
        known = [field[key] for field in numbers["fields"] if field[key] is not None]
        best[key] = (max(known) if sign > 0 else min(known)) if sign and len(known) > 1 else None
    for k, field in enumerate(numbers["fields"]):
        cells = [
            {
                "text": "–" if field[key] is None else form(field[key]),
                "best": best[key] is not None and field[key] == best[key],
            }
            for _, key, form, _ in COLUMNS
        ]
        yield {**field, "index": k, "tone": _tone(k), "cells": cells, "told": facts_of(field["facts"])}


def _tone(index: int) -> str:
    return f"tone-{index % TONES}"


def _rules(fields: Sequence[ComparedField]) -> Iterator[dict[str, str]]:
    """A class per picture: ``reference-VIEW``, ``prediction-FIELD-VIEW``, ``difference-…``, ``regions-…``."""
    for k, field in enumerate(fields):
        for v, view in enumerate(field.data.views):
            pictures = figures.view_pictures(view, view_unit(view))
            for name, data in pictures.items():
                if name != "reference":
                    yield {"name": f"{name}-{k}-{v}", "data": data}
                elif k == 0:
                    yield {"name": f"reference-{v}", "data": data}


def _seam(field: Numbers) -> dict[str, Any]:
    """Mean errors near and away from borders over the views of a field."""
    pairs = [view["border"] for view in field["per_view"] if view["border"]]
    means = {key: float(np.mean([pair[key] for pair in pairs])) for key in ("border", "interior", "share")}
    return {"field": field, "high": field["border_ratio"] > HIGH_BORDER, **means}


def _object_row(ranked: Sequence[Numbers], index: int) -> dict[str, Any]:
    """Errors of one object by field. All fields are scored at the same points, so the order of objects is the same."""
    first = ranked[0]["per_object"][index]
    cells = []
    for field in ranked:
        error = field["per_object"][index]["relative_error"]
        ratio = error / max(field["relative_error"], 1e-9)
        heat = f"{min(max(25 * (ratio - 0.5), 0), 65):.0f}"
        cells.append({"error": error, "high": ratio > HIGH_OBJECT, "heat": heat})
    return {"name": first["name"], "floor": first["noise_floor"], "cells": cells}


# ---------------------------------------------------------------------- charts


def _charts(numbers: Numbers) -> list[dict[str, Any]]:
    """Error over bytes, multiply-adds, training time and light position."""
    size = ChartAxis("bytes as stored", lambda v: brief_amount(v, "B"), log=True)
    cost = ChartAxis("multiply-adds per pixel", brief_amount, log=True)
    caption = "Error over multiply-adds. A field without any is not shown; table reads are in the table above."
    noise = "Error on validation samples while training; their noise is larger than that of the held-out points."
    sweep = "Error at held-out positions along the sweep of the light; peaks are positions near a surface."
    return [
        {"svg": _scatter(numbers, "bytes", size, "Error over size"), "caption": "Error over size."},
        {"svg": _scatter(numbers, "macs_per_pixel", cost, "Error over multiply-adds"), "caption": caption},
        {"svg": _training(numbers), "caption": noise},
        {"svg": _sweep(numbers), "caption": sweep},
    ]


def _scatter(numbers: Numbers, key: str, x: ChartAxis, title: str) -> str:
    points = [
        ScatterPoint(field["name"], field[key], field["relative_error"], _tone(k), MARKERS[k % len(MARKERS)])
        for k, field in enumerate(numbers["fields"])
    ]
    y = ChartAxis("relative error", brief_percent, log=True)
    return scatter_chart(points, x, y, title, numbers["noise_floor"])


def _lines(numbers: Numbers, table: str, x: str) -> list[ChartSeries]:
    """A line of relative errors for each field."""
    found = []
    for k, field in enumerate(numbers["fields"]):
        xs, ys = ([point[key] for point in field[table]] for key in (x, "relative_error"))
        found.append(ChartSeries(field["name"], xs, ys, tone=_tone(k)))
    return found


def _training(numbers: Numbers) -> str:
    lines = _lines(numbers, "training", "seconds")
    xs = [x for line in lines for x in line.x if x > 0]
    if not xs:
        return ""
    floor = ChartSeries("noise floor", [min(xs), max(xs)], [numbers["noise_floor"]] * 2, dashed=True, tone="floor")
    x = ChartAxis("training time", brief_duration, log=True)
    y = ChartAxis("validation error", brief_percent, log=True)
    return charts.line_chart([*lines, floor], x, y, "Error over training time")


def _sweep(numbers: Numbers) -> str:
    first = numbers["fields"][0]["sweep"]
    at, floors = ([point[key] for point in first] for key in ("at", "noise_floor"))
    floor = ChartSeries("noise floor", at, floors, dashed=True, tone="floor")
    x, y = ChartAxis(numbers["sweep_axis"], brief), ChartAxis("relative error", brief_percent, log=True)
    return charts.line_chart([*_lines(numbers, "sweep", "at"), floor], x, y, "Error along the sweep of the light")
