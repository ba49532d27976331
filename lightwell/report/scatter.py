"""Scatter chart of labelled points, such as error over size, with the Pareto front and a noise floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from lightwell.report.charts import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, ChartAxis, ChartScale, draw, ends

# Half the size of a marker, and the approximate width of a character of a label, user units.
RADIUS, CHARACTER = 4.5, 6.3
# Positions of a label around its point, in order of preference: offset of its anchor, and its text-anchor.
PLACES = ((9, -7, "start"), (9, 4, "start"), (0, -10, "middle"), (0, 18, "middle"), (-9, -7, "end"), (-9, 16, "end"))
MARKERS = ("circle", "square", "diamond", "triangle")


@dataclass(frozen=True)
class ScatterPoint:
    """One labelled point."""

    name: str
    x: float
    y: float
    tone: str
    """CSS class of its colour."""
    marker: str = "circle"


def scatter_chart(
    points: Sequence[ScatterPoint], x: ChartAxis, y: ChartAxis, title: str, floor: float | None = None
) -> Markup:
    """Draw labelled points and their Pareto front (those that no other point undercuts in both directions).

    Args:
        points: The points; values ≤ 0 are omitted on a logarithmic axis.
        x: Horizontal axis.
        y: Vertical axis.
        title: Title for screen readers.
        floor: Noise floor on the vertical axis; None for none.

    Returns:
        SVG; empty when there is nothing to draw.
    """
    points = [p for p in points if (p.x > 0 or not x.log) and (p.y > 0 or not y.log)]
    if not points:
        return Markup()
    low, high = ends([p.x for p in points], x.log)
    if x.log:  # room for labels on both sides
        low, high = low / 1.6, high * 1.9
    heights = [p.y for p in points] + ([floor] if floor else [])
    x_scale = ChartScale(low, high, LEFT, WIDTH - RIGHT, x.log)
    y_scale = ChartScale(*ends(heights, y.log), HEIGHT - BOTTOM, TOP, y.log)
    placed = [(p, x_scale(p.x), y_scale(p.y)) for p in points]
    dots = [
        {"name": p.name, "tone": p.tone, "path": _marker(p.marker, px, py), "x": tx, "y": ty, "anchor": anchor}
        for (p, px, py), (tx, ty, anchor) in zip(placed, _labels(placed))
    ]
    front = _front(points, x_scale, y_scale)
    return draw(x, y, x_scale, y_scale, title, dots=dots, front=front, floor=y_scale(floor) if floor else None)


def _front(points: Sequence[ScatterPoint], x: ChartScale, y: ChartScale) -> str:
    """The corners of a staircase through the points of the Pareto front."""
    best = float("inf")
    corners: list[tuple[float, float]] = []
    for point in sorted(points, key=lambda p: (p.x, p.y)):
        if point.y < best:
            if corners:
                corners.append((x(point.x), y(best)))
            corners.append((x(point.x), y(point.y)))
            best = point.y
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in corners)


def _marker(marker: str, x: float, y: float) -> str:
    """Outline of a marker, as the commands of an SVG path."""
    r = RADIUS
    return {
        "circle": f"M{x - r:.1f} {y:.1f}a{r} {r} 0 1 0 {2 * r} 0a{r} {r} 0 1 0 {-2 * r} 0z",
        "square": f"M{x - r:.1f} {y - r:.1f}h{2 * r}v{2 * r}h{-2 * r}z",
        "diamond": f"M{x:.1f} {y - 1.3 * r:.1f}l{1.3 * r} {1.3 * r}l{-1.3 * r} {1.3 * r}l{-1.3 * r} {-1.3 * r}z",
        "triangle": f"M{x:.1f} {y - 1.2 * r:.1f}l{1.2 * r} {2.1 * r}h{-2.4 * r}z",
    }[marker]


def _labels(placed: Sequence[tuple[ScatterPoint, float, float]]) -> list[tuple[float, float, str]]:
    """Place a label beside every point, where it covers neither another point nor an earlier label: x, y, anchor."""
    taken = [(x - RADIUS, y - RADIUS, x + RADIUS, y + RADIUS) for _, x, y in placed]
    found = []
    for point, x, y in placed:
        boxes = [_box(point.name, x, y, *place) for place in PLACES]
        clear = [k for k, box in enumerate(boxes) if _inside(box) and not any(_overlap(box, other) for other in taken)]
        k = clear[0] if clear else 0
        taken.append(boxes[k])
        dx, dy, anchor = PLACES[k]
        found.append((round(x + dx, 1), round(y + dy, 1), anchor))
    return found


def _box(text: str, x: float, y: float, dx: float, dy: float, anchor: str) -> tuple[float, float, float, float]:
    width = CHARACTER * len(text)
    left = x + dx - {"start": 0.0, "middle": width / 2, "end": width}[anchor]
    return left, y + dy - 10, left + width, y + dy + 3


def _inside(box: tuple[float, float, float, float]) -> bool:
    return box[0] >= LEFT and box[2] <= WIDTH and box[1] >= TOP - 12 and box[3] <= HEIGHT - BOTTOM


def _overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
