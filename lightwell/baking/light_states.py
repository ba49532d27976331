"""Errors over the hours of a day and the angles of an environment map, and what a view shows of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lightwell.report.records import PointComparison
from lightwell.report.summary import point_scores
from lightwell.scenes.movers import Mover
from lightwell.scenes.variables import Sun, Turning, Variable, has_sky

if TYPE_CHECKING:
    from lightwell.scenes.movers import Pose

# What the charts of the error over the light show to the right.
SWEEP, HOURS, DEGREES = "position along the sweep", "hour of the day", "turn of the environment, degrees"
# Parts of a day: elevation of the sun from, to; degrees.
PARTS_OF_DAY = (("twilight", -90.0, 0.0), ("low sun", 0.0, 10.0), ("day", 10.0, 91.0))
# Held-out lights are joined to so many states of about equal number: 32 lights have four each.
STATES = 8


def axis_of(variable: Variable | None) -> str:
    """Name the axis of charts over a light.

    Args:
        variable: Ranges of the light; None: no light varies.

    Returns:
        ``HOURS``, ``DEGREES``, or ``SWEEP`` where a light has neither.
    """
    if isinstance(variable, Turning):
        return DEGREES
    return HOURS if has_sky(variable) and variable.sky and variable.sky.hours else SWEEP


def axis_value(variable: Variable | None, light: np.ndarray) -> float | None:
    """Convert a light to a value on its axis.

    Args:
        variable: Ranges of the light; None: no light varies.
        light: [3] direction of the sun, or of the map's north.

    Returns:
        Hours or degrees; None where the axis is ``SWEEP``.
    """
    if isinstance(variable, Turning):
        return float(variable.angle(light))
    return variable.hour(light) if has_sky(variable) else None


def axis_of_mover(mover: Mover) -> str:
    """Name the axis of charts over the range of a mover.

    Args:
        mover: The mover.

    Returns:
        Its name and unit.
    """
    return f"{mover.name}, {mover.unit}"


def states_of_view(
    lights: Sequence[tuple[Variable | None, np.ndarray]], movers: Sequence[Mover], pose: Pose | None
) -> dict[str, float]:
    """Say what a view shows, as values on the axes of the charts.

    Args:
        lights: Ranges and place [3] of each light that varies.
        movers: What moves in the scene.
        pose: Their sliders; None: nothing moves.

    Returns:
        Axis → value.
    """
    values = {axis_of(variable): axis_value(variable, light) for variable, light in lights}
    moved = {axis_of_mover(mover): mover.value(float(slider)) for mover, slider in zip(movers, pose or ())}
    return {axis: value for axis, value in values.items() if value is not None} | moved


def errors_over_light(
    comparison: PointComparison, lights: np.ndarray, variable: Variable | None, unit: float
) -> list[dict[str, Any]]:
    """Compute the error of a field over the hours of a day or the angles of a map, at held-out points.

    Args:
        comparison: N points, whatever their poses.
        lights: [N, 3] light at each.
        variable: Ranges of the light.
        unit: Radiance unit S.

    Returns:
        Mean place on the axis, number of lights and points, error and noise floor of each state, in order; nothing for
        a light without an axis.
    """
    different, row = np.unique(np.round(lights, 6), axis=0, return_inverse=True)
    values = [axis_value(variable, light) for light in different]
    if not values or None in values:
        return []
    order, found = np.argsort(values), []
    for group in np.array_split(order, min(STATES, len(order))):
        rows = np.flatnonzero(np.isin(row.reshape(-1), group))
        mean = float(np.mean([values[k] for k in group]))
        found.append({"at": mean, "lights": len(group), **_errors(comparison, rows, unit)})
    return found


def times_of_day(comparison: PointComparison, lights: np.ndarray, variable: Sun, unit: float) -> list[dict[str, Any]]:
    """Compute the error of a field over parts of the day, at held-out points and times.

    Args:
        comparison: N points.
        lights: [N, 3] direction to the sun at each.
        variable: A sun with a sky.
        unit: Radiance unit S.

    Returns:
        Name, number of times, error and noise floor of each part that the path has.
    """
    height = np.degrees(np.arcsin(np.clip(lights[:, 1], -1, 1)))
    found = []
    for name, low, high in PARTS_OF_DAY:
        rows = np.flatnonzero((height >= low) & (height < high))
        if len(rows):
            times = len(np.unique(np.round(variable.time(lights[rows]), 6)))
            found.append({"name": name, "times": times, **_errors(comparison, rows, unit)})
    return found


def _errors(c: PointComparison, rows: np.ndarray, unit: float) -> dict[str, Any]:
    """Number of points, error and noise floor of some of the points."""
    weight = None if c.weight is None else c.weight[rows]
    part = PointComparison(c.prediction[rows], c.half_a[rows], c.half_b[rows], c.shape[rows], c.objects, weight)
    told = point_scores(part, unit)
    return {"points": len(rows), "relative_error": told["relative_error"], "noise_floor": told["noise_floor"]}
