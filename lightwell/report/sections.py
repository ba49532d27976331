"""Sections of report.html, each a function from the numbers to HTML. Every text from outside is escaped."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from lightwell.report import charts, figures
from lightwell.report.facts import facts_html
from lightwell.report.numbers import amount, brief, brief_duration, brief_percent, digits, duration, grouped, percent

# Largest number of objects in the bar chart; the table has all of them.
MAX_BARS = 16

TERMS = (
    (
        "Relative error",
        "|f − y| / (y + 0.01), averaged over held-out points that are distributed uniformly over all surfaces: f is "
        "the learned radiance, y the path-traced reference, both in the unit S, four times the mean radiance of the "
        "scene. Lights and views of these points were not used in training.",
    ),
    (
        "Noise floor",
        "The relative error that remains in the reference, from the difference between its two independent halves. A "
        "perfect prediction has this error; an error near it cannot be distinguished from noise.",
    ),
    (
        "Relative MSE",
        "(f − A)(f − B) / (y² + 0.01²), with A and B the two halves of the reference: a squared error without the "
        "noise of the reference. Near 0 it can be negative by chance.",
    ),
    (
        "Energy ratio",
        "Mean learned light divided by mean reference light. 1 means that none is lost or added on average.",
    ),
    (
        "PSNR",
        "Peak signal-to-noise ratio of the displayed picture. Above 40 dB a difference is hard to see. The ceiling is "
        "the value of a perfect prediction, limited by the noise of the reference.",
    ),
    ("SSIM", "Structural similarity of the displayed picture, 1 for identical ones."),
    (
        "FLIP",
        "The difference that an observer notices when alternating between the displayed pictures at 67 pixels per "
        "degree: 0 is none, 1 is black against white.",
    ),
)


def masthead(data: Mapping[str, Any]) -> str:
    """Build the title and the main result.

    Args:
        data: Content of ``report.json``.

    Returns:
        HTML.
    """
    about = f"{escape(data['field'])} · preset {escape(data['preset'])} · seed {data['seed']}"
    return f"""<header><p class="eyebrow">lightwell report</p>
<h1>{escape(data["scene"])}</h1><p class="soft">{about}</p>
{_verdict(data)}<div class="hero"><div class="number">{percent(data["relative_error"])}</div>
<p>is the mean relative error of the learned indirect light against the path-traced reference, over
{grouped(data["points"])} held-out surface points. The noise floor of the reference is
{percent(data["noise_floor"])}.</p></div></header>"""


def _quality_cards(quality: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Cards of what the pictures show, the noise of the reference taken off."""
    cards = (
        ("psnr_db", "PSNR, noise off", "dB", "Of the displayed indirect light, the noise of the reference taken off."),
        ("flip", "FLIP, whole picture", "", "Direct light included; 0 is none."),
        ("mottle", "Mottle", "", "Spread of learned over reference light on smooth lit surfaces: blotches."),
        ("leak", "Leak", "%", "Wrong light on the darkest quarter of the surface, over the mean of all."),
    )
    made = []
    for key, name, sign, why in cards:
        if (value := quality.get(key)) is not None:
            text = percent(value) if sign == "%" else digits(value) + (f"\u202f{sign}" if sign else "")
            made.append((name, text, why))
    return made


def _verdict(data: Mapping[str, Any]) -> str:
    """The verdict in words, first of all."""
    return f'<p class="verdict"><strong>{escape(data["verdict"])}</strong></p>' if data.get("verdict") else ""


def headline(data: Mapping[str, Any]) -> str:
    """Build the cards of the main numbers, each with its meaning.

    Args:
        data: Content of ``report.json``.

    Returns:
        HTML.
    """
    seconds = data["seconds"]
    spread = f"Half of all points have a smaller error; 95\u202f% have one below {percent(data['relative_error_p95'])}."
    time = " · ".join(f"{escape(k)} {duration(v)}" for k, v in seconds.items() if k != "total")
    rate = f"Traced for training, {amount(data['paths_per_second'])} per second."
    whole = f"Weights and textures. The whole asset: {amount(data['asset_bytes'], 'B')}."
    size = "Weights and textures of the learned light." if data["asset_bytes"] is None else whole
    cards = [("Median error", percent(data["relative_error_median"]), spread)]
    if data["per_view"]:
        ceiling = f"Of the displayed pictures; a perfect one would score {digits(data['psnr_ceiling_db'])}\u202fdB."
        cards += [
            ("PSNR", f"{digits(data['psnr_db'])}\u202fdB", ceiling),
            ("SSIM", f"{data['ssim']:.4f}", "Structural similarity; 1 is identical."),
            (
                "FLIP",
                digits(data["flip"]),
                "Difference noticed when alternating between both; 0 is none.",
            ),
        ]
    cards += _quality_cards(data.get("quality") or {})
    cards += [
        ("Energy ratio", digits(data["energy_ratio"], 4), "Learned over reference light; 1: none is lost or added."),
        ("Size", amount(data["bytes"], "B"), size),
        ("Cost per pixel", f"{amount(data['macs_per_pixel'])} MAC", _pixel(data["fetches_per_pixel"])),
        ("Time to bake", duration(seconds["total"]), time),
    ]
    # Light maps do not count paths.
    cards += [("Paths", amount(data["paths"]), rate)] if data["paths"] else []
    items = "".join(
        f'<div><dt>{name}</dt><dd><div class="value">{value}</div><div class="why">{why}</div></dd></div>'
        for name, value, why in cards
    )
    return f'<dl class="cards">{items}</dl>'


def _pixel(fetches: int | None) -> str:
    """Describe the cost of a pixel: multiply-adds, and table entries that are read."""
    beside = f", and {grouped(fetches)} table reads" if fetches else ""
    return f"Multiply-adds of the network per pixel{beside}."


def warnings(texts: Sequence[str], title: str = "Limits of this bake") -> str:
    """Build the list of what could not be done.

    Args:
        texts: Warnings, plain text.
        title: Heading.

    Returns:
        HTML; empty when there are none.
    """
    if not texts:
        return ""
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f'<div class="warnings"><strong>{title}</strong><ul>{items}</ul></div>'


def view(number: int, scores: Mapping[str, Any], pictures: Mapping[str, bytes], tile: Mapping[str, bytes]) -> str:
    """Build the panels of a held-out view, its worst tile, and its scores.

    Args:
        number: Position of the view in the page, for unique ids.
        scores: Entry of ``per_view``.
        pictures: Name → PNG, from ``figures.view_pictures``.
        tile: Name → PNG, from ``figures.worst_tile_pictures``.

    Returns:
        HTML.
    """
    name, caption = escape(scores["name"]), escape(scores["caption"])
    worst = scores["worst_tile"]
    line = (
        f"Error {percent(scores['relative_error'])} (floor {percent(scores['noise_floor'])}), "
        f"PSNR {digits(scores['psnr_db'])} dB (ceiling {digits(scores['psnr_ceiling_db'])} dB), "
        f"SSIM {scores['ssim']:.4f}, FLIP {digits(scores['flip'])}."
        f"{seams(scores['border'])}"
    )
    return f"""<figure><h3>{name}</h3>
<div class="panels">{_panels(pictures, scores["name"])}</div>
<div class="below"><div class="scale"><p>|learned − reference| / reference</p>{difference_scale(number)}</div>
<div><p>Worst 16 × 16 tile, framed above: {percent(worst["relative_error"])}</p>
<div class="panels small">{_panels(tile, "worst tile of " + scores["name"], sharp=True)}</div></div></div>
<figcaption>{caption + ". " if caption else ""}{line}</figcaption></figure>"""


def seams(border: Mapping[str, float] | None) -> str:
    """Describe the error beside borders between regions.

    Args:
        border: Errors near and away from borders; None where there are no borders.

    Returns:
        A sentence; empty where there are no borders.
    """
    if not border:
        return ""
    ratio = border["border"] / border["interior"]
    return f" Within 3 pixels of a border between regions the error is {ratio:.2f} × that of the interior."


def _panels(pictures: Mapping[str, bytes], name: str, sharp: bool = False) -> str:
    titles = {"prediction": "learned", "reference": "path-traced", "difference": "difference", "regions": "regions"}
    panels = []
    for key, data in pictures.items():
        source = f"data:image/png;base64,{base64.b64encode(data).decode()}"
        text = escape(f"{titles[key]}, {name}", quote=True)
        style = "panel sharp" if sharp else "panel"
        panels.append(f'<div class="{style}"><img alt="{text}" src="{source}"><span>{titles[key]}</span></div>')
    return "".join(panels)


def difference_scale(number: int) -> str:
    """Draw the colour scale of the log-difference, the same in every report.

    Args:
        number: Number that makes the ids of the SVG unique in a page.

    Returns:
        SVG.
    """
    low, high = figures.DIFFERENCE_LOW, figures.DIFFERENCE_HIGH
    stops = "".join(
        f'<stop offset="{i / (len(figures.INFERNO) - 1):.3f}" stop-color="rgb({r},{g},{b})"/>'
        for i, (r, g, b) in enumerate(figures.INFERNO)
    )
    marks = "".join(
        f'<text x="{(at - low) / (high - low) * 320:.1f}" y="28" text-anchor="middle">{label}</text>'
        for at, label in ((-2, "1\u202f%"), (-1, "10\u202f%"), (0, "100\u202f%"))
    )
    return (
        '<svg viewBox="0 0 320 32" role="img"><title>Colour scale of the difference</title><defs>'
        f'<linearGradient id="scale-{number}">{stops}</linearGradient></defs>'
        f'<rect width="320" height="12" rx="3" fill="url(#scale-{number})"/>{marks}</svg>'
    )


def curves(data: Mapping[str, Any]) -> str:
    """Build the charts of training, the sweep of the light, and the objects.

    Args:
        data: Content of ``report.json``.

    Returns:
        HTML; empty when there is nothing to draw.
    """
    parts = []
    if data["training"]:
        parts.append(_chart(_training_chart(data), "Error on validation samples while training."))
    if data["sweep"]:
        parts.append(_chart(_sweep_chart(data), "Error at held-out positions along the sweep of the light."))
    rows = sorted(data["per_object"], key=lambda row: -row["relative_error"])[:MAX_BARS]
    if rows:
        bars = [(row["name"], row["relative_error"], row["noise_floor"]) for row in rows]
        caption = "Error by object, worst first; the thin mark is the noise floor."
        parts.append(_chart(charts.bar_chart(bars, percent, "Error by object"), caption))
    return f'<h2>Where the error is</h2><div class="charts">{"".join(parts)}</div>' if parts else ""


def about_the_field(data: Mapping[str, Any]) -> str:
    """Build the section with the facts that the field reports about itself.

    Args:
        data: Content of ``report.json``.

    Returns:
        HTML; empty when there are none.
    """
    told = facts_html(data["facts"])
    return f"<h2>Facts about the field</h2>{told}" if told else ""


def _chart(svg: str, caption: str) -> str:
    return f"<figure>{svg}<figcaption>{caption}</figcaption></figure>"


def _training_chart(data: Mapping[str, Any]) -> str:
    xs, ys = ([point[key] for point in data["training"]] for key in ("seconds", "relative_error"))
    lines = [charts.ChartSeries("validation error", xs, ys)]
    lines.append(charts.ChartSeries("noise floor", [min(xs), max(xs)], [data["noise_floor"]] * 2, dashed=True))
    x, y = (
        charts.ChartAxis("training time", brief_duration, log=True),
        charts.ChartAxis("relative error", brief_percent, log=True),
    )
    return charts.line_chart(lines, x, y, "Error while training")


def _sweep_chart(data: Mapping[str, Any]) -> str:
    columns = {key: [point[key] for point in data["sweep"]] for key in ("at", "relative_error", "noise_floor")}
    lines = [
        charts.ChartSeries("learned", columns["at"], columns["relative_error"]),
        charts.ChartSeries("noise floor", columns["at"], columns["noise_floor"], dashed=True),
    ]
    x, y = charts.ChartAxis("position along the sweep", brief), charts.ChartAxis("relative error", brief_percent)
    return charts.line_chart(lines, x, y, "Error along the sweep of the light")


def table(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Build a table: the first column is text, the others are numbers.

    Args:
        headers: Headings; escaped.
        rows: Cells of every row; escaped.

    Returns:
        HTML.
    """
    body = "".join(f"<tr>{_cells('td', row)}</tr>" for row in rows)
    head = f"<thead><tr>{_cells('th', headers)}</tr></thead>"
    return f'<div class="scroll"><table>{head}<tbody>{body}</tbody></table></div>'


def _cells(tag: str, texts: Sequence[str]) -> str:
    first, *rest = (escape(text) for text in texts)
    return f"<{tag}>{first}</{tag}>" + "".join(f'<{tag} class="n">{text}</{tag}>' for text in rest)


def pairs(entries: Mapping[str, Any]) -> str:
    """Build a table of names and values.

    Args:
        entries: Name → text or JSON value; escaped.

    Returns:
        HTML.
    """
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(_text(value))}</td></tr>" for name, value in entries.items()
    )
    return f'<div class="scroll"><table class="text"><tbody>{rows}</tbody></table></div>'


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def tables(data: Mapping[str, Any]) -> str:
    """Build the tables of numbers per view and per object.

    Args:
        data: Content of ``report.json``.

    Returns:
        HTML.
    """
    views = [
        (
            v["name"],
            percent(v["relative_error"]),
            percent(v["noise_floor"]),
            digits(v["psnr_db"]),
            f"{v['ssim']:.4f}",
            digits(v["flip"]),
            digits(v["energy_ratio"], 4),
        )
        for v in data["per_view"]
    ]
    objects = [
        (
            o["name"],
            grouped(o["points"]),
            percent(o["relative_error"]),
            percent(o["noise_floor"]),
            digits(o["energy_ratio"], 4),
        )
        for o in data["per_object"]
    ]
    by_view = table(("View", "Error", "Floor", "PSNR, dB", "SSIM", "FLIP", "Energy"), views) if views else ""
    by_object = table(("Object", "Points", "Error", "Floor", "Energy"), objects)
    return f"<h2>The numbers</h2>{by_view}{by_object}"


def terms(data: Mapping[str, Any], more: Sequence[tuple[str, str]] = ()) -> str:
    """Build the explanations of all metrics.

    Args:
        data: Content of ``report.json``.
        more: Further (name, explanation), HTML.

    Returns:
        HTML.
    """
    items = "".join(f"<dt>{name}</dt><dd>{text}</dd>" for name, text in (*TERMS, *more))
    tone = f"<dt>Displayed</dt><dd>{escape(data['tone_mapping'])}. Here S is {digits(data['unit'])}.</dd>"
    return f'<h2>How to read this</h2><dl class="terms">{items}{tone}</dl>'


def provenance(data: Mapping[str, Any]) -> str:
    """Build the section on settings, versions and licences.

    Args:
        data: Content of ``report.json``.

    Returns:
        HTML.
    """
    settings = f"<div><h3>Settings</h3>{pairs(data['settings'])}</div>" if data["settings"] else ""
    versions = f"<div><h3>Versions</h3>{pairs(data['versions'])}</div>"
    items = "".join(f"<li>{escape(line)}</li>" for line in data["licences"])
    licences = f"<h3>Licences</h3><ul>{items}</ul>" if items else ""
    return f'<h2>How it was made</h2><div class="columns">{settings}{versions}</div>{licences}'
