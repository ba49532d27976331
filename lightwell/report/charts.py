"""Line and bar charts as inline SVG; the page's style sheet defines their colours, light and dark.

Class names: ``grid``, ``line line-0``, ``line-1`` …, ``tone-0`` … where a series names its own, ``bar``, ``mark``,
``label``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from markupsafe import Markup

from lightwell.report.pages import TEMPLATES

# Size and margins of a line chart, user units (CSS pixels at full size).
WIDTH, HEIGHT = 560, 280
LEFT, RIGHT, TOP, BOTTOM = 46, 12, 34, 46
# Bar chart, user units: height of a row and of its bar, width of the columns of names and of values.
ROW, THICKNESS, NAMES, VALUES = 24, 10, 168, 96
# Approximate number of ticks of a linear axis.
LINEAR_TICKS = 5
# Longest name that fits beside a bar, characters.
MAX_NAME = 22


@dataclass(frozen=True)
class ChartSeries:
    """A line of a chart."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    dashed: bool = False
    tone: str = ""
    """CSS class of its colour, such as ``tone-3`` or ``floor``; empty: by its position in the chart."""


@dataclass(frozen=True)
class ChartAxis:
    """Label, format and scaling of one axis."""

    label: str
    format: Callable[[float], str]
    """Converts a value to the text of its tick."""
    log: bool = False


@dataclass(frozen=True)
class ChartScale:
    """Maps values of an axis to user units of the SVG."""

    low: float
    high: float
    start: float
    end: float
    log: bool

    def __call__(self, value: float) -> float:
        """Map a value.

        Args:
            value: Value on the axis; > 0 on a logarithmic one.

        Returns:
            Position in user units, to a tenth.
        """
        low, high, value = (math.log10(v) if self.log else v for v in (self.low, self.high, value))
        return round(self.start + (value - low) / (high - low) * (self.end - self.start), 1)


def draw(x: ChartAxis, y: ChartAxis, x_scale: ChartScale, y_scale: ChartScale, title: str, **content: object) -> Markup:
    """Draw the axes of a chart and what it shows.

    Args:
        x: Horizontal axis.
        y: Vertical axis.
        x_scale: Scale of the horizontal axis.
        y_scale: Scale of the vertical axis.
        title: Title for screen readers.
        **content: What ``templates/chart.html`` draws: lines, dots, front, floor.

    Returns:
        SVG.
    """
    marks = [
        [{"at": scale(value), "label": axis.format(value)} for value in ticks(scale.low, scale.high, axis.log)]
        for axis, scale in ((x, x_scale), (y, y_scale))
    ]
    chart = {
        "width": WIDTH,
        "height": HEIGHT,
        "left": LEFT,
        "right": WIDTH - RIGHT,
        "bottom": HEIGHT - BOTTOM,
        "title": title,
        "x_label": x.label,
        "y_label": y.label,
        "x_ticks": marks[0],
        "y_ticks": marks[1],
        "lines": [],
        "dots": [],
        "front": "",
        "floor": None,
    }
    return TEMPLATES.render("chart.html", chart=chart | content)


def line_chart(series: Sequence[ChartSeries], x: ChartAxis, y: ChartAxis, title: str) -> Markup:
    """Draw one or more lines over shared axes; values ≤ 0 are omitted on a logarithmic axis.

    Args:
        series: Lines.
        x: Horizontal axis.
        y: Vertical axis.
        title: Title for screen readers.

    Returns:
        SVG and legend; empty when there is nothing to draw.
    """
    series = [_drawable(s, x.log, y.log) for s in series]
    xs = [v for s in series for v in s.x]
    ys = [v for s in series for v in s.y]
    if not xs:
        return Markup()
    x_scale = ChartScale(*ends(xs, x.log, tight=True), LEFT, WIDTH - RIGHT, x.log)
    y_scale = ChartScale(*ends(ys, y.log), HEIGHT - BOTTOM, TOP, y.log)
    lines = []
    for k, s in enumerate(series):
        # A single point is written twice: a line of length zero with round ends is displayed as a dot.
        places = list(zip(s.x, s.y)) * (2 if len(s.x) == 1 else 1)
        style = (s.tone or f"line-{k}") + (" dashed" if s.dashed else "")
        points = " ".join(f"{x_scale(a)},{y_scale(b)}" for a, b in places)
        lines.append({"name": s.name, "style": style, "points": points})
    return draw(x, y, x_scale, y_scale, title, lines=lines)


def bar_chart(rows: Sequence[tuple[str, float, float]], format: Callable[[float], str], title: str) -> Markup:
    """Draw horizontal bars, each with a thin mark.

    Args:
        rows: (name, value, mark) of every bar, values ≥ 0; the mark is for example a noise floor.
        format: Converts a value to text.
        title: Title for screen readers.

    Returns:
        SVG; empty when there are no bars.
    """
    if not rows:
        return Markup()
    scale = ChartScale(0, max(max(v, m) for _, v, m in rows) or 1, NAMES, WIDTH - VALUES, False)
    bars = [
        {
            "name": name,
            "length": max(scale(value) - NAMES, 0.5),
            "mark": scale(mark),
            "end": max(scale(value), scale(mark)) + 8,
            "label": format(value),
        }
        for name, value, mark in rows
    ]
    sizes = {"width": WIDTH, "row": ROW, "thickness": THICKNESS, "names": NAMES, "longest": MAX_NAME}
    return TEMPLATES.render("bars.html", bars=bars, title=title, **sizes)


def _drawable(series: ChartSeries, log_x: bool, log_y: bool) -> ChartSeries:
    pairs = [(x, y) for x, y in zip(series.x, series.y) if (x > 0 or not log_x) and (y > 0 or not log_y)]
    return replace(series, x=[x for x, _ in pairs], y=[y for _, y in pairs])


def ends(values: Sequence[float], log: bool, tight: bool = False) -> tuple[float, float]:
    """Choose the ends of an axis.

    Args:
        values: All values on the axis, not empty.
        log: The axis is logarithmic; then values are > 0.
        tight: Use the range of the values; otherwise with a margin, and linear axes start at 0.

    Returns:
        Lowest and highest value of the axis.
    """
    low, high = min(values), max(values)
    if log:
        margin = 1.0 if tight else 1.25
        return low / margin, high * margin if high > low else high * 2
    return (low if tight else min(low, 0.0)), (high if tight and high > low else (high * 1.1 or 1.0))


def ticks(low: float, high: float, log: bool) -> list[float]:
    """Choose round values between the ends of an axis.

    Args:
        low: Lowest value.
        high: Highest value, > ``low``.
        log: The axis is logarithmic; then ``low`` > 0.

    Returns:
        Values, ascending.
    """
    if not log:
        step = _round_step((high - low) / LINEAR_TICKS)
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        return [i * step for i in range(first, last + 1)]
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    # Few decades leave room for ticks between them.
    multiples = (1,) if len(decades) > 4 else (1, 3) if len(decades) > 3 else (1, 2, 5)
    values = [m * 10.0**d for d in decades for m in multiples]
    return [v for v in values if low * (1 - 1e-9) <= v <= high * (1 + 1e-9)]


def _round_step(step: float) -> float:
    base = 10.0 ** math.floor(math.log10(step))
    return next(m * base for m in (1, 2, 5, 10) if m * base >= step * (1 - 1e-9))
