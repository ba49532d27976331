"""Tables and charts of what a field reports about itself (``Fit.facts``).

Supported forms, by the type of a value:

    number, text, boolean              a row of the table
    [number, …]                        a curve over the x axis of its dictionary or where it is long; else bars by index
    [[number, …], …]                   one curve per column (for example the share of every expert over time)
    {name: [number, …], …}             one curve per name; a name of ``ABSCISSAE`` (``step`` …) is the x axis
    {name: number, …}                  bars (a histogram)
    {name: anything, …}                its entries, prefixed by its name
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

from markupsafe import Markup

from lightwell.report import charts
from lightwell.report.numbers import brief, plain

# Names whose list is the horizontal axis of the other curves in its dictionary.
ABSCISSAE = ("step", "steps", "seconds", "epoch", "epochs", "round", "rounds")
# Number of colours, which then repeat; largest number of bars or curves in a chart.
TONES, MOST = 12, 24


@dataclass(frozen=True)
class Facts:
    """What is drawn of a field's facts."""

    rows: Sequence[tuple[str, str]]
    """Name and text of each row of the table."""
    charts: Sequence[tuple[str, Markup]]
    """Caption and SVG of each chart."""


def facts_of(facts: Mapping[str, Any]) -> Facts:
    """Sort facts into charts and rows of a table.

    Args:
        facts: Name → value in one of the supported forms.

    Returns:
        The charts and rows.
    """
    return Facts(*_parts(facts))


def _parts(facts: Mapping[str, Any], prefix: str = "") -> tuple[list[tuple[str, str]], list[tuple[str, Markup]]]:
    """Return the rows of the table and the charts with their captions."""
    rows: list[tuple[str, str]] = []
    figures: list[tuple[str, Markup]] = []
    shared = next(((key, facts[key]) for key in ABSCISSAE if _numbers(facts.get(key))), None)
    for key, value in facts.items():
        name = _words(prefix + key)
        if shared and key == shared[0]:
            continue
        if _numbers(value) and len(value) <= MOST and not (shared and len(shared[1]) == len(value)):
            figures.append(_bars(name, {str(k): number for k, number in enumerate(value)}))
        elif _numbers(value) or _table(value):
            figures.append(_curves(name, value if _table(value) else [[v] for v in value], shared))
        elif isinstance(value, Mapping) and value and all(_number(v) for v in value.values()):
            figures.append(_bars(name, value))
        elif isinstance(value, Mapping) and _same_lengths(value):
            figures.append(_named_curves(name, value))
        elif isinstance(value, Mapping):
            more_rows, more_figures = _parts(value, f"{prefix}{key}, ")
            rows, figures = rows + more_rows, figures + more_figures
        else:
            rows.append((name, plain(value)))
    return rows, figures


def _curves(
    name: str, table: Sequence[Sequence[float]], shared: tuple[str, Sequence[float]] | None
) -> tuple[str, Markup]:
    """Draw one line per column of [time][column]."""
    x = shared[1] if shared and len(shared[1]) == len(table) else range(1, len(table) + 1)
    columns = list(zip(*table))[:MOST]
    names = [name] if len(columns) == 1 else [f"{k}" for k in range(len(columns))]
    label = shared[0] if shared and len(shared[1]) == len(table) else "in order"
    return _chart(name, dict(zip(names, columns)), x, label)


def _named_curves(name: str, lists: Mapping[str, Sequence[float]]) -> tuple[str, Markup]:
    axis = next((key for key in ABSCISSAE if key in lists), None)
    lines = {key: values for key, values in lists.items() if key != axis}
    x = lists[axis] if axis else range(1, len(next(iter(lists.values()))) + 1)
    return _chart(name, dict(list(lines.items())[:MOST]), x, axis or "in order")


def _chart(name: str, lines: Mapping[str, Sequence[float]], x: Sequence[float], label: str) -> tuple[str, Markup]:
    series = [
        charts.ChartSeries(_words(key), list(x), list(values), tone=f"tone-{k % TONES}")
        for k, (key, values) in enumerate(lines.items())
    ]
    return name, charts.line_chart(series, charts.ChartAxis(_words(label), brief), charts.ChartAxis("", brief), name)


def _bars(name: str, values: Mapping[str, float]) -> tuple[str, Markup]:
    rows = [(_words(key), float(value), 0.0) for key, value in list(values.items())[:MOST]]
    left_out = f" ({len(values) - MOST} more)" if len(values) > MOST else ""
    return f"{name}{left_out}", charts.bar_chart(rows, plain, name)


def _number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _numbers(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str) and len(value) > 1 and all(map(_number, value))


def _table(value: Any) -> bool:
    """Whether the value is [time][column] with at least two times."""
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) < 2:
        return False
    rows = [row for row in value if isinstance(row, Sequence) and not isinstance(row, str) and row]
    return len(rows) == len(value) and len({len(row) for row in rows}) == 1 and all(_number(v) for r in rows for v in r)


def _same_lengths(value: Mapping[str, Any]) -> bool:
    return bool(value) and all(map(_numbers, value.values())) and len({len(v) for v in value.values()}) == 1


def _words(key: str) -> str:
    return key.replace("_", " ")
