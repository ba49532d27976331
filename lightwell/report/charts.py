"""Line and bar charts as inline SVG; the page's style sheet defines their colours, light and dark.

Every text is escaped. Class names: ``grid``, ``line line-0``, ``line-1`` …, ``tone-0`` … where a series names its own,
``bar``, ``mark``, ``label``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from html import escape

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

    def style(self, index: int) -> str:
        """Return the CSS classes of the line and its legend key.

        Args:
            index: Position of the series in the chart, from 0.

        Returns:
            Class names, separated by spaces.
        """
        return (self.tone or f"line-{index}") + (" dashed" if self.dashed else "")


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
            Position in user units.
        """
        low, high, value = (math.log10(v) if self.log else v for v in (self.low, self.high, value))
        return self.start + (value - low) / (high - low) * (self.end - self.start)


def line_chart(series: Sequence[ChartSeries], x: ChartAxis, y: ChartAxis, title: str) -> str:
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
        return ""
    x_scale = ChartScale(*ends(xs, x.log, tight=True), LEFT, WIDTH - RIGHT, x.log)
    y_scale = ChartScale(*ends(ys, y.log), HEIGHT - BOTTOM, TOP, y.log)
    parts = [horizontal_axis(x, x_scale), vertical_axis(y, y_scale)]
    parts += [_line(s, i, x_scale, y_scale) for i, s in enumerate(series)]
    return svg(WIDTH, HEIGHT, title, parts) + _legend(series)


def bar_chart(rows: Sequence[tuple[str, float, float]], format: Callable[[float], str], title: str) -> str:
    """Draw horizontal bars, each with a thin mark.

    Args:
        rows: (name, value, mark) of every bar, values ≥ 0; the mark is for example a noise floor.
        format: Converts a value to text.
        title: Title for screen readers.

    Returns:
        SVG; empty when there are no bars.
    """
    if not rows:
        return ""
    scale = ChartScale(0, max(max(v, m) for _, v, m in rows) or 1, NAMES, WIDTH - VALUES, False)
    parts = []
    for i, (name, value, mark) in enumerate(rows):
        middle = i * ROW + ROW / 2
        short = name if len(name) <= MAX_NAME else name[: MAX_NAME - 1] + "…"
        top, length = middle - THICKNESS / 2, max(scale(value) - NAMES, 0.5)
        parts += [
            f'<text class="name" x="{NAMES - 10}" y="{middle + 4:.1f}" text-anchor="end">{escape(short)}</text>',
            f'<rect class="bar" x="{NAMES}" y="{top:.1f}" width="{length:.1f}" height="{THICKNESS}" rx="2"/>',
            f'<path class="mark" d="M{scale(mark):.1f} {top - 3:.1f}v{THICKNESS + 6}"/>',
            f'<text class="label" x="{max(scale(value), scale(mark)) + 8:.1f}" y="{middle + 4:.1f}">'
            f"{escape(format(value))}</text>",
        ]
    return svg(WIDTH, len(rows) * ROW, title, parts)


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


def horizontal_axis(axis: ChartAxis, scale: ChartScale) -> str:
    """Draw line, ticks and label below a chart.

    Args:
        axis: Label and format.
        scale: Scale of the axis.

    Returns:
        SVG elements.
    """
    bottom = HEIGHT - BOTTOM
    parts = [f'<path class="axis" d="M{LEFT} {bottom}H{WIDTH - RIGHT}"/>']
    for value in ticks(scale.low, scale.high, axis.log):
        label = escape(axis.format(value))
        parts.append(f'<text class="tick" x="{scale(value):.1f}" y="{bottom + 18}" text-anchor="middle">{label}</text>')
    right = WIDTH - RIGHT
    parts.append(f'<text class="title" x="{right}" y="{HEIGHT - 8}" text-anchor="end">{escape(axis.label)}</text>')
    return "".join(parts)


def vertical_axis(axis: ChartAxis, scale: ChartScale) -> str:
    """Draw grid lines, ticks and label of the vertical axis.

    Args:
        axis: Label and format.
        scale: Scale of the axis.

    Returns:
        SVG elements.
    """
    parts = []
    for value in ticks(scale.low, scale.high, axis.log):
        at = scale(value)
        parts.append(f'<path class="grid" d="M{LEFT} {at:.1f}H{WIDTH - RIGHT}"/>')
        parts.append(
            f'<text class="tick" x="{LEFT - 8}" y="{at + 4:.1f}" text-anchor="end">{escape(axis.format(value))}</text>'
        )
    parts.append(f'<text class="title" x="0" y="12">{escape(axis.label)}</text>')
    return "".join(parts)


def _line(series: ChartSeries, index: int, x: ChartScale, y: ChartScale) -> str:
    # A single point is written twice: a line of length zero with round ends is displayed as a dot.
    places = list(zip(series.x, series.y)) * (2 if len(series.x) == 1 else 1)
    points = " ".join(f"{x(a):.1f},{y(b):.1f}" for a, b in places)
    return f'<polyline class="line {series.style(index)}" points="{points}"/>'


def _legend(series: Sequence[ChartSeries]) -> str:
    if len(series) < 2:
        return ""
    keys = "".join(
        f'<span><i class="key {s.style(i).replace("line-", "key-")}"></i>{escape(s.name)}</span>'
        for i, s in enumerate(series)
    )
    return f'<p class="keys">{keys}</p>'


def svg(width: int, height: int, title: str, parts: Sequence[str]) -> str:
    """Wrap SVG elements.

    Args:
        width: Width, user units.
        height: Height, user units.
        title: Title for screen readers.
        parts: SVG elements.

    Returns:
        The ``svg`` element.
    """
    body = "".join(parts)
    return f'<svg viewBox="0 0 {width} {height}" role="img"><title>{escape(title)}</title>{body}</svg>'
