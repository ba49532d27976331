"""Charts of the error over what varies: hours, angles, poses and lamps, each with its worst state in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lightwell.core.sun_path import clock
from lightwell.report import charts, figures
from lightwell.report.charts import ChartAxis, ChartSeries
from lightwell.report.numbers import brief, brief_percent, digits, percent
from lightwell.report.records import ViewComparison
from lightwell.report.summary import view_unit

# Facts that are drawn here, and not in the table of the field's facts.
DRAWN = (
    *("times_of_day", "errors_over_lights", "movers", "error_of_each_lamp", "error_of_all_lamps"),
    *("error_of_random_lamps", "worst_random_lamps"),
)
# Axes whose values are written in another way than as a number: what the sentence calls the range, and the value.
HOURS, DEGREES = "hour of the day", "turn of the environment, degrees"
# Largest number of bars of lamps.
MOST_LAMPS = 24


def state_charts(numbers: Mapping[str, Any], views: Sequence[ViewComparison]) -> list[dict[str, Any]]:
    """Draw a chart for everything that varies.

    Args:
        numbers: Content of ``report.json``.
        views: The held-out views, whose pictures are shown beside the worst states.

    Returns:
        ``svg``, ``caption`` and ``example`` of each: pictures of the view that is nearest to the worst state, None
        where no view shows what varies.
    """
    facts = numbers["facts"]
    found = [_sweep_chart(numbers, views)]
    found += [_light_chart(light, facts, views) for light in facts.get("errors_over_lights", ())]
    found += [_mover_chart(mover, views) for mover in facts.get("movers", ())]
    return [*found, _lamp_chart(facts)]


def _sweep_chart(numbers: Mapping[str, Any], views: Sequence[ViewComparison]) -> dict[str, Any]:
    """The error along the sweep: of a light, or of the first thing that moves."""
    axis, rows = numbers["sweep_axis"], numbers["sweep"]
    chart = _curve(rows, axis, "Error along the sweep of the light", "noise_floor")
    moved = next((m["name"] for m in numbers["facts"].get("movers", ()) if f"{m['name']}, {m['unit']}" == axis), None)
    caption = {
        HOURS: "Error over the hours of the day, at times that were not learned",
        DEGREES: "Error over the turn of the environment, at angles that were not learned",
    }.get(axis, "Error at held-out positions along the sweep")
    # The first thing that moves takes the place of the light: its light stands still then.
    caption = f"Error over the range of {moved} of what stands still, under one light" if moved else caption
    worst = _worst(rows)
    told = [caption, *_worst_words(worst, axis, "noise_floor")]
    # Parts of the day stand under the chart of its hours, wherever that is.
    parts = _parts_of_day(numbers["facts"]) if axis == HOURS else ""
    return {"svg": chart, "caption": "; ".join(told) + "." + parts, "example": _example(worst, axis, views)}


def _light_chart(light: Mapping[str, Any], facts: Mapping[str, Any], views: Sequence[ViewComparison]) -> dict[str, Any]:
    """The error over a light that the sweep does not show, from held-out points at any pose of what moves."""
    axis, rows = light["axis"], light["states"]
    title = "Error over the hours of the day" if axis == HOURS else f"Error over the {axis.partition(',')[0]}"
    worst = _worst(rows)
    told = [f"{title}, whatever else varies", *_worst_words(worst, axis, "noise_floor")]
    parts = _parts_of_day(facts) if axis == HOURS else ""
    svg = _curve(rows, axis, title, "noise_floor")
    return {"svg": svg, "caption": "; ".join(told) + "." + parts, "example": _example(worst, axis, views)}


def _mover_chart(mover: Mapping[str, Any], views: Sequence[ViewComparison]) -> dict[str, Any]:
    """The chart of what moves, and its worst pose and what leaks at its end stops in words."""
    rows, name = mover["poses"], mover["name"]
    axis, worst = f"{name}, {mover['unit']}", mover.get("worst_pose") or _worst(rows)
    told = [f"Error over the range of {name}", *_worst_words(worst, axis, "noise")]
    for stop in mover.get("end_stops", ()):
        if stop["leak"] is not None:
            leak = percent(stop["leak"])
            told.append(f"at {_value(stop['value'], axis)} {leak} of the light of the other end leaks into the dark")
    svg = _curve(rows, axis, f"Error over {name}", "noise")
    return {"svg": svg, "caption": "; ".join(told) + ".", "example": _example(worst, axis, views)}


def _lamp_chart(facts: Mapping[str, Any]) -> dict[str, Any]:
    """The error of each lamp alone, of all and of random switches; worst first."""
    alone = sorted(facts.get("error_of_each_lamp", {}).items(), key=lambda row: -row[1])
    together = {
        "all together": facts.get("error_of_all_lamps"),
        "random switches, mean": facts.get("error_of_random_lamps"),
        "random switches, worst": facts.get("worst_random_lamps", {}).get("relative_error"),
    }
    rows = [(name, error, 0.0) for name, error in alone[:MOST_LAMPS]]
    rows += [(name, error, 0.0) for name, error in together.items() if error is not None]
    told = ["Error of each lamp alone at held-out points, noise of the reference included"]
    if alone:
        told.append(f"worst alone: {alone[0][0]} with {percent(alone[0][1])}")
    told += [f"{name} {percent(error)}" for name, error in together.items() if error is not None]
    if on := facts.get("worst_random_lamps", {}).get("on"):
        told[-1] += f", with {', '.join(on)} on"
    if len(alone) > MOST_LAMPS:
        told.append(f"the {len(alone) - MOST_LAMPS} best are not drawn")
    return {"svg": charts.bar_chart(rows, percent, "Error by lamp"), "caption": "; ".join(told) + ".", "example": None}


def _curve(rows: Sequence[Mapping[str, Any]], axis: str, title: str, floor: str) -> str:
    at, error, noise = ([row[key] for row in rows] for key in (_place(rows), "relative_error", floor))
    lines = [ChartSeries("learned", at, error), ChartSeries("noise floor", at, noise, dashed=True)]
    x = ChartAxis(axis, clock if axis == HOURS else brief)
    return charts.line_chart(lines, x, ChartAxis("relative error", brief_percent), title)


def _place(rows: Sequence[Mapping[str, Any]]) -> str:
    """The key of a state's place: poses have values, lights are at a place."""
    return "value" if rows and "value" in rows[0] else "at"


def _worst(rows: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    return max(rows, key=lambda row: row["relative_error"], default=None)


def _worst_words(worst: Mapping[str, Any] | None, axis: str, floor: str) -> list[str]:
    if worst is None:
        return []
    noise = f" (noise floor {percent(worst[floor])})" if floor in worst else ""
    return [f"worst at {_value(worst[_place([worst])], axis)} with {percent(worst['relative_error'])}{noise}"]


def _value(value: float, axis: str) -> str:
    if axis == HOURS:
        return clock(value)
    unit = {"degrees": "°", "metres": "\u202fm"}.get(axis.rpartition(", ")[2], "")
    return f"{digits(value)}{unit}"


def _parts_of_day(facts: Mapping[str, Any]) -> str:
    """A sentence with the errors of twilight, low sun and day."""
    parts = [f"{part['name']} {percent(part['relative_error'])}" for part in facts.get("times_of_day", ())]
    text = ", ".join(parts)
    return f" {text[0].upper()}{text[1:]}." if text else ""


def _example(worst: Mapping[str, Any] | None, axis: str, views: Sequence[ViewComparison]) -> dict[str, Any] | None:
    """Pictures of the view that is nearest to the worst state."""
    shown = [view for view in views if axis in view.states]
    if worst is None or not shown:
        return None
    at = worst[_place([worst])]
    view = min(shown, key=lambda view: abs(view.states[axis] - at))
    value, asked = _value(view.states[axis], axis), _value(at, axis)
    # Views have a few states of their own, and those of a day a sun that is up.
    text = f"at {value}" if value == asked else f"at {value}, the picture nearest to {asked}"
    pictures = figures.view_pictures(view, view_unit(view))
    return {"title": view.name, "text": text, "pictures": pictures}
