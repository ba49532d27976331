"""Line and bar charts as inline SVG; the page's style sheet gives them their colours, light and dark.

Every text is escaped. Class names: ``grid``, ``line line-0``, ``line-1`` …, ``bar``, ``mark``, ``label``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

# Size and margins of a line chart, user units (CSS pixels at full size).
WIDTH, HEIGHT = 560, 280
LEFT, RIGHT, TOP, BOTTOM = 46, 12, 34, 46
# Geometry of a bar chart: a row, its bar, the column of names, the column of values.
ROW, THICKNESS, NAMES, VALUES = 24, 10, 168, 96
# Ticks that a linear axis aims for.
LINEAR_TICKS = 5
# Longest name that fits beside a bar, characters.
MAX_NAME = 22


@dataclass(frozen=True)
class Series:
    """A line of a chart."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    dashed: bool = False


@dataclass(frozen=True)
class Axis:
    """One direction of a chart."""

    label: str
    format: Callable[[float], str]
    """A value as its tick says it."""
    log: bool = False


@dataclass(frozen=True)
class _Scale:
    """Values of an axis to user units."""

    low: float
    high: float
    start: float
    end: float
    log: bool

    def __call__(self, value: float) -> float:
        low, high, value = (math.log10(v) if self.log else v for v in (self.low, self.high, value))
        return self.start + (value - low) / (high - low) * (self.end - self.start)


def line_chart(series: Sequence[Series], x: Axis, y: Axis, title: str) -> str:
    """An SVG of one or more lines over shared axes; points that a logarithm cannot show are left out."""
    series = [_drawable(s, x.log, y.log) for s in series]
    xs = [v for s in series for v in s.x]
    ys = [v for s in series for v in s.y]
    if not xs:
        return ""
    x_scale = _Scale(*_range(xs, x.log, tight=True), LEFT, WIDTH - RIGHT, x.log)
    y_scale = _Scale(*_range(ys, y.log), HEIGHT - BOTTOM, TOP, y.log)
    parts = [_horizontal_axis(x, x_scale), _vertical_axis(y, y_scale)]
    parts += [_line(s, i, x_scale, y_scale) for i, s in enumerate(series)]
    return _svg(WIDTH, HEIGHT, title, parts) + _legend(series)


def bar_chart(rows: Sequence[tuple[str, float, float]], format: Callable[[float], str], title: str) -> str:
    """An SVG of horizontal bars: (name, value, mark), with a thin mark on each bar (a noise floor)."""
    if not rows:
        return ""
    scale = _Scale(0, max(max(v, m) for _, v, m in rows) or 1, NAMES, WIDTH - VALUES, False)
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
    return _svg(WIDTH, len(rows) * ROW, title, parts)


def _drawable(series: Series, log_x: bool, log_y: bool) -> Series:
    pairs = [(x, y) for x, y in zip(series.x, series.y) if (x > 0 or not log_x) and (y > 0 or not log_y)]
    return Series(series.name, [x for x, _ in pairs], [y for _, y in pairs], series.dashed)


def _range(values: Sequence[float], log: bool, tight: bool = False) -> tuple[float, float]:
    """Ends of an axis: the data's own when ``tight``, else with room around it; linear axes start at 0."""
    low, high = min(values), max(values)
    if log:
        margin = 1.0 if tight else 1.25
        return low / margin, high * margin if high > low else high * 2
    return (low if tight else min(low, 0.0)), (high if tight and high > low else (high * 1.1 or 1.0))


def ticks(low: float, high: float, log: bool) -> list[float]:
    """Round values between the ends of an axis."""
    if not log:
        step = _round_step((high - low) / LINEAR_TICKS)
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        return [i * step for i in range(first, last + 1)]
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    # Few decades leave room for the steps between them.
    multiples = (1,) if len(decades) > 4 else (1, 3) if len(decades) > 3 else (1, 2, 5)
    values = [m * 10.0**d for d in decades for m in multiples]
    return [v for v in values if low * (1 - 1e-9) <= v <= high * (1 + 1e-9)]


def _round_step(step: float) -> float:
    base = 10.0 ** math.floor(math.log10(step))
    return next(m * base for m in (1, 2, 5, 10) if m * base >= step * (1 - 1e-9))


def _horizontal_axis(axis: Axis, scale: _Scale) -> str:
    bottom = HEIGHT - BOTTOM
    parts = [f'<path class="axis" d="M{LEFT} {bottom}H{WIDTH - RIGHT}"/>']
    for value in ticks(scale.low, scale.high, axis.log):
        label = escape(axis.format(value))
        parts.append(f'<text class="tick" x="{scale(value):.1f}" y="{bottom + 18}" text-anchor="middle">{label}</text>')
    right = WIDTH - RIGHT
    parts.append(f'<text class="title" x="{right}" y="{HEIGHT - 8}" text-anchor="end">{escape(axis.label)}</text>')
    return "".join(parts)


def _vertical_axis(axis: Axis, scale: _Scale) -> str:
    parts = []
    for value in ticks(scale.low, scale.high, axis.log):
        at = scale(value)
        parts.append(f'<path class="grid" d="M{LEFT} {at:.1f}H{WIDTH - RIGHT}"/>')
        parts.append(
            f'<text class="tick" x="{LEFT - 8}" y="{at + 4:.1f}" text-anchor="end">{escape(axis.format(value))}</text>'
        )
    parts.append(f'<text class="title" x="0" y="12">{escape(axis.label)}</text>')
    return "".join(parts)


def _line(series: Series, index: int, x: _Scale, y: _Scale) -> str:
    points = " ".join(f"{x(a):.1f},{y(b):.1f}" for a, b in zip(series.x, series.y))
    dashed = " dashed" if series.dashed else ""
    return f'<polyline class="line line-{index}{dashed}" points="{points}"/>'


def _legend(series: Sequence[Series]) -> str:
    if len(series) < 2:
        return ""
    keys = "".join(
        f'<span><i class="key key-{i}{" dashed" if s.dashed else ""}"></i>{escape(s.name)}</span>'
        for i, s in enumerate(series)
    )
    return f'<p class="keys">{keys}</p>'


def _svg(width: int, height: int, title: str, parts: Sequence[str]) -> str:
    body = "".join(parts)
    return f'<svg viewBox="0 0 {width} {height}" role="img"><title>{escape(title)}</title>{body}</svg>'
