"""Sections of compare.html, each a function from the numbers to HTML. Every text from outside is escaped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from lightwell.report import charts, sections
from lightwell.report.charts import ChartAxis, ChartSeries
from lightwell.report.facts import TONES, facts_html
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
from lightwell.report.scatter import MARKERS, ScatterPoint, scatter_chart

# Highlighted: an object whose error is above this multiple of the field's mean, and a seam above this ratio.
HIGH_OBJECT, HIGH_BORDER = 3.0, 1.2
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


def _tone(index: int) -> str:
    return f"tone-{index % TONES}"


def _swatch(index: int) -> str:
    return f'<i class="swatch {_tone(index)}"></i>'


def _ranked(numbers: Numbers) -> list[tuple[int, Numbers]]:
    """Return (index, field), smallest error first."""
    return sorted(enumerate(numbers["fields"]), key=lambda item: item[1]["relative_error"])


def masthead(numbers: Numbers) -> str:
    """Build the title and the main result.

    Args:
        numbers: Content of ``compare.json``.

    Returns:
        HTML.
    """
    _, best = _ranked(numbers)[0]
    count = len(numbers["fields"])
    settings = numbers["settings"]
    time = f"{settings['fixed_steps']} steps" if settings.get("fixed_steps") else "the same time"
    return f"""<header><p class="eyebrow">lightwell comparison</p>
<h1>{escape(numbers["scene"])}</h1>
<p class="soft">{count} field{"s" if count != 1 else ""} on the same {grouped(settings["samples"])} path-traced samples
({duration(numbers["trace_seconds"])} of tracing), trained for {time} each · seed {numbers["seed"]}</p>
<div class="hero"><div class="number">{percent(best["relative_error"])}</div>
<p>is the smallest error, that of <strong>{escape(best["name"])}</strong>, over {grouped(numbers["points"])} surface
points under held-out lights. The noise floor of the path-traced reference is {percent(numbers["noise_floor"])}; errors
near it cannot be distinguished from noise.</p></div></header>"""


def fields_table(numbers: Numbers) -> str:
    """Build the table of fields, smallest error first; the best value of each column is highlighted.

    Args:
        numbers: Content of ``compare.json``.

    Returns:
        HTML.
    """
    fields = numbers["fields"]
    best = {}
    for _, key, _, sign in COLUMNS:
        known = [field[key] for field in fields if field[key] is not None]
        best[key] = (max(known) if sign > 0 else min(known)) if sign and len(known) > 1 else None
    rows = []
    for index, field in _ranked(numbers):
        link = f'<a href="{escape(field["folder"], quote=True)}/report.html">{escape(field["name"])}</a>'
        cells = [f"<td>{_swatch(index)}{link}</td>"]
        for _, key, form, _ in COLUMNS:
            value = field[key]
            kind = "n best" if value is not None and value == best[key] else "n"
            cells.append(f'<td class="{kind}">{"–" if value is None else escape(form(value))}</td>')
        rows.append(f"<tr>{''.join(cells)}</tr>")
    heads = "".join(f'<th class="n">{escape(heading)}</th>' for heading, *_ in COLUMNS)
    return (
        '<h2>The fields</h2><div class="wide"><div class="scroll"><table class="fields">'
        f"<thead><tr><th>Field</th>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table></div></div>"
        f"{_limits(numbers)}"
    )


def _limits(numbers: Numbers) -> str:
    """State what the noise of the reference leaves measurable."""
    if numbers["psnr_ceiling_db"] is None:
        return ""
    return (
        '<p class="soft note">The noise of the reference limits what can be measured: a perfect field would have an '
        f"error of {percent(numbers['noise_floor'])} and a PSNR of {digits(numbers['psnr_ceiling_db'])} dB. "
        "<code>--truth 10m</code> traces a reference with less noise.</p>"
    )


# ---------------------------------------------------------------------- charts


def cost_charts(numbers: Numbers) -> str:
    """Build the charts of error over bytes, multiply-adds, training time and light position.

    Args:
        numbers: Content of ``compare.json``.

    Returns:
        HTML.
    """
    parts = [
        _scatter(
            numbers, "bytes", ChartAxis("bytes as stored", lambda v: brief_amount(v, "B"), log=True), "Error over size."
        ),
        _scatter(
            numbers,
            "macs_per_pixel",
            ChartAxis("multiply-adds per pixel", brief_amount, log=True),
            "Error over multiply-adds. A field without any is not shown; table reads are in the table above.",
        ),
        _training(numbers),
        _sweep(numbers),
    ]
    about = "Lower left is better; the thin line is the Pareto front."
    figures = "".join(part for part in parts if part)
    heading = f'<h2>Error over size, cost, training time and light position</h2><p class="soft">{about}</p>'
    return f'{heading}<div class="charts trio">{figures}</div>'


def _scatter(numbers: Numbers, key: str, x: ChartAxis, caption: str) -> str:
    points = [
        ScatterPoint(field["name"], field[key], field["relative_error"], _tone(k), MARKERS[k % len(MARKERS)])
        for k, field in enumerate(numbers["fields"])
    ]
    svg = scatter_chart(
        points, x, ChartAxis("relative error", brief_percent, log=True), caption, numbers["noise_floor"]
    )
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>" if svg else ""


def _training(numbers: Numbers) -> str:
    lines = [
        ChartSeries(
            field["name"],
            [point["seconds"] for point in field["training"]],
            [point["relative_error"] for point in field["training"]],
            tone=_tone(k),
        )
        for k, field in enumerate(numbers["fields"])
        if field["training"]
    ]
    xs = [x for line in lines for x in line.x if x > 0]
    if not xs:
        return ""
    floor = ChartSeries("noise floor", [min(xs), max(xs)], [numbers["noise_floor"]] * 2, dashed=True, tone="floor")
    x = ChartAxis("training time", brief_duration, log=True)
    y = ChartAxis("validation error", brief_percent, log=True)
    svg = charts.line_chart([*lines, floor], x, y, "Error over training time")
    caption = "Error on validation samples while training; their noise is larger than that of the held-out points."
    return f"<figure>{svg}<figcaption>{caption}</figcaption></figure>"


def _sweep(numbers: Numbers) -> str:
    lines = []
    for k, field in enumerate(numbers["fields"]):
        at, errors = ([point[key] for point in field["sweep"]] for key in ("at", "relative_error"))
        lines.append(ChartSeries(field["name"], at, errors, tone=_tone(k)))
    first = numbers["fields"][0]["sweep"]
    at, floors = ([point[key] for point in first] for key in ("at", "noise_floor"))
    lines.append(ChartSeries("noise floor", at, floors, dashed=True, tone="floor"))
    x, y = ChartAxis("position along the sweep", brief), ChartAxis("relative error", brief_percent, log=True)
    svg = charts.line_chart(lines, x, y, "Error along the sweep of the light")
    caption = "Error at held-out positions along the sweep of the light; peaks are positions near a surface."
    return f"<figure>{svg}<figcaption>{caption}</figcaption></figure>"


# ---------------------------------------------------------------------- pictures


def _picture(name: str, label: str, title: str) -> str:
    text = escape(label, quote=True)
    picture = f'<div class="picture {name}" role="img" aria-label="{text}"></div>'
    return f'<div class="panel">{picture}<span>{title}</span></div>'


def contact_sheet(numbers: Numbers) -> str:
    """Build the first view as rendered by every field, beside the reference.

    Args:
        numbers: Content of ``compare.json``.

    Returns:
        HTML; empty when there is no view.
    """
    views = numbers["fields"][0]["per_view"]
    if not views:
        return ""
    pictures = [_picture("reference-0", f"path-traced, {views[0]['name']}", "path-traced")]
    for k, field in _ranked(numbers):
        title = f"{_swatch(k)}{escape(field['name'])} · {percent(field['per_view'][0]['relative_error'])}"
        pictures.append(_picture(f"prediction-{k}-0", f"learned by {field['name']}", title))
    about = f"Indirect light only, {escape(views[0]['caption'])}, a held-out light; the same exposure."
    return f'<h2>Side by side</h2><p class="soft">{about}</p><div class="sheet">{"".join(pictures)}</div>'


def panels(numbers: Numbers) -> str:
    """Build the panels of every field: learned light, reference, difference, and regions of the experts.

    Args:
        numbers: Content of ``compare.json``.

    Returns:
        HTML.
    """
    fields = "".join(_field_panels(k, field) for k, field in _ranked(numbers))
    scale = (
        f'<div class="scale"><p class="soft">log₁₀ of (|learned − reference| + 0.0001) / (reference + 0.01), '
        f"the same scale everywhere</p>{sections.difference_scale(0)}</div>"
    )
    return f"<h2>Every field</h2>{scale}{fields}"


def _field_panels(index: int, field: Numbers) -> str:
    views = [_view_panels(index, field, v) for v in range(len(field["per_view"]))]
    more = ""
    if len(views) > 1:
        count = len(views) - 1
        more = f"<details><summary>{count} more view{'s' if count > 1 else ''}</summary>{''.join(views[1:])}</details>"
    told = facts_html(field["facts"])
    facts = f"<details><summary>Facts about {escape(field['name'])}</summary>{told}</details>" if told else ""
    links = (
        f'<a href="{escape(field["folder"], quote=True)}/index.html">open the page</a> · '
        f'<a href="{escape(field["folder"], quote=True)}/report.html">its report</a>'
    )
    cut = ", stopped by the time limit before its schedule ended" if field["cut"] else ""
    line = (
        f"Error {percent(field['relative_error'])}, {digits(field['psnr_db'])} dB, {amount(field['bytes'], 'B')}, "
        f"{amount(field['macs_per_pixel'])} MAC per pixel, {grouped(field['steps'])} steps{cut}. {links}"
        if field["psnr_db"] is not None
        else links
    )
    return (
        f'<section class="one-field"><h3>{_swatch(index)}{escape(field["name"])}</h3><p class="soft">{line}</p>'
        f"{''.join(views[:1])}{more}{facts}</section>"
    )


def _view_panels(index: int, field: Numbers, number: int) -> str:
    scores = field["per_view"][number]
    name, view = scores["name"], f"{index}-{number}"
    if field["segments"] is None:
        regions = '<div class="panel"><div class="none">one network, no segments</div><span>segments</span></div>'
    else:
        regions = _picture(f"regions-{view}", f"segments, {name}", "segments")
    pictures = (
        _picture(f"prediction-{view}", f"learned, {name}", "learned")
        + _picture(f"reference-{number}", f"path-traced, {name}", "path-traced")
        + _picture(f"difference-{view}", f"difference, {name}", "difference")
        + regions
    )
    line = (
        f"{escape(name)}: error {percent(scores['relative_error'])} (floor {percent(scores['noise_floor'])}), "
        f"PSNR {digits(scores['psnr_db'])} dB (ceiling {digits(scores['psnr_ceiling_db'])} dB), "
        f"SSIM {scores['ssim']:.4f}, FLIP {digits(scores['flip'])}."
        f"{sections.seams(scores['border'])}"
    )
    return f'<figure><div class="panels four">{pictures}</div><figcaption>{line}</figcaption></figure>'


# ---------------------------------------------------------------------- where the error is


def where(numbers: Numbers) -> str:
    """Build the tables of errors beside region borders and by object.

    Args:
        numbers: Content of ``compare.json``.

    Returns:
        HTML.
    """
    return f"<h2>Where the error is</h2>{_borders(numbers)}{_objects(numbers)}"


def _borders(numbers: Numbers) -> str:
    rows = [(k, field) for k, field in _ranked(numbers) if field["border_ratio"] is not None]
    if not rows:
        return ""
    body = []
    for k, field in rows:
        pairs = [view["border"] for view in field["per_view"] if view["border"]]
        border, interior, share = (sum(p[key] for p in pairs) / len(pairs) for key in ("border", "interior", "share"))
        high = " high" if field["border_ratio"] > HIGH_BORDER else ""
        body.append(
            f'<tr><td>{_swatch(k)}{escape(field["name"])}</td><td class="n">{field["segments"]}</td>'
            f'<td class="n">{percent(border)}</td><td class="n">{percent(interior)}</td>'
            f'<td class="n{high}">{field["border_ratio"]:.2f}</td><td class="n">{percent(share)}</td></tr>'
        )
    heads = _heads(("Field", "Experts in view", "Border error", "Interior error", "Ratio", "Pixels near borders"))
    about = "Seams: the error within 3 pixels of a border between experts, and away from every border."
    return (
        f'<h3>Seams</h3><p class="soft">{about}</p><div class="scroll"><table>'
        f"<thead><tr>{heads}</tr></thead><tbody>{''.join(body)}</tbody></table></div>"
    )


def _objects(numbers: Numbers) -> str:
    """Build a table of objects by fields; a darker cell is a larger error."""
    ranked = _ranked(numbers)
    # All fields are scored at the same points, so that their objects are in the same order; names may repeat.
    first = ranked[0][1]["per_object"]
    rows = sorted(range(len(first)), key=lambda k: -first[k]["relative_error"])[:MOST_OBJECTS]
    body = []
    for k in rows:
        cells = "".join(_heat(f["per_object"][k]["relative_error"], f["relative_error"]) for _, f in ranked)
        floor = percent(first[k]["noise_floor"])
        body.append(f'<tr><td>{escape(first[k]["name"])}</td><td class="n">{floor}</td>{cells}</tr>')
    heads = '<th>Object</th><th class="n">Noise floor</th>' + "".join(
        f'<th class="n">{_swatch(k)}{escape(field["name"])}</th>' for k, field in ranked
    )
    left_out = len(first) - len(rows)
    more = f" {left_out} objects with smaller errors are in compare.json." if left_out else ""
    about = f"Bold: more than {HIGH_OBJECT:g} times the field's mean error.{more}"
    return (
        f'<h3>By object</h3><p class="soft">{about}</p><div class="wide"><div class="scroll"><table class="fields fit">'
        f"<thead><tr>{heads}</tr></thead><tbody>{''.join(body)}</tbody></table></div></div>"
    )


def _heat(error: float, mean: float) -> str:
    ratio = error / max(mean, 1e-9)
    kind = "n heat high" if ratio > HIGH_OBJECT else "n heat"
    return f'<td class="{kind}" style="--heat: {min(max(25 * (ratio - 0.5), 0), 65):.0f}">{percent(error)}</td>'


def _heads(texts: Sequence[str]) -> str:
    first, *rest = (escape(text) for text in texts)
    return f"<th>{first}</th>" + "".join(f'<th class="n">{text}</th>' for text in rest)


def terms(numbers: Numbers) -> str:
    """Build the explanations of all figures.

    Args:
        numbers: Content of ``compare.json``.

    Returns:
        HTML.
    """
    own = (
        ("Bytes, zlib", "Weights and tables of the learned light as stored, and compressed by zlib."),
        ("Fetches", "Table entries that the shading graph reads per pixel, in addition to its multiply-adds."),
        (
            "Training",
            "Wall time of a field's training, including its preparation of the samples; tracing the samples is shared "
            "and not included.",
        ),
        (
            "Segments",
            "The expert that is evaluated at a point, one colour each; hatched where a second expert is blended in. A "
            "field of one network has none.",
        ),
    )
    return sections.terms(numbers, own)
