"""Daylight along the path of a sun: sunlight and skylight in physical ratio, as numbers that any runtime evaluates.

The model of the clear sky is that of Hošek & Wilkie 2012 and 2013, as Mitsuba's ``sunsky`` holds it. Its radiance in a
direction at angle θ from the zenith and γ from the sun is, for each colour,

    L(θ, γ) = (1 + a exp(b / (cos θ + 0.01))) (c + d exp(e γ) + f cos² γ + g (1 + cos² γ) / (1 + h² − 2 h cos γ)^1.5
              + i √cos θ),

with nine numbers that change with the height of the sun. They are given for K times t in [0, 1] along the path; between
two of them L itself is interpolated, with the angle γ to where the sun is then. Below the horizon it is dark.

All light is in units of the brightest light of the day: 1 is what reaches a small sphere, sun and sky together, at the
brightest of the K times (luminance of ``sun`` plus the integral of L over the sky).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from lightwell.core.color import LUMINANCE

# Rows and columns of the sky's cells: all of one solid angle, rows by the sine of the elevation, columns by azimuth.
ROWS, COLUMNS = 24, 96
# Points of a cell along each axis, whose mean is its radiance.
PER_CELL = 3
# Steps of the tables along the path.
STEPS = 257
# Numbers of the model for each colour.
COEFFICIENTS = 9


@dataclass(frozen=True)
class Sky:
    """Sunlight and skylight at K times along the path of a sun."""

    times: tuple[float, ...]
    """K increasing times from 0 to 1."""
    sun: tuple[tuple[float, ...], ...]
    """K times red, green, blue: irradiance of the sun at normal incidence."""
    model: tuple[tuple[float, ...], ...]
    """K times a … i of red, of green and of blue."""
    level: tuple[float, ...]
    """K brightnesses, at most 1: what a small sphere receives of sun and sky, relative to the brightest time. A field
    is learned for light divided by it."""
    turbidity: float
    """Haze of the air, 1 (clear) to 10."""
    hours: tuple[float, ...] = ()
    """Clock at t = 0, 1/2 and 1, hours; empty where the path is not that of a day."""

    @staticmethod
    def of(entry: dict[str, Any]) -> Sky:
        """Read what ``json`` wrote.

        Args:
            entry: JSON object.

        Returns:
            The sky.

        Raises:
            ValueError: The numbers do not fit together.
        """
        times = tuple(float(t) for t in entry["times"])
        sun, model = (tuple(tuple(map(float, row)) for row in entry[name]) for name in ("sun", "model"))
        level = tuple(float(v) for v in entry["level"])
        whole = all(len(row) == 3 for row in sun) and all(len(row) == 3 * COEFFICIENTS for row in model)
        if not (len(times) == len(sun) == len(model) == len(level) >= 2 and whole and min(level) > 0):
            raise ValueError("times, sun, model and level of a sky must be as many, and no level 0")
        hours = tuple(float(h) for h in entry.get("hours", ()))
        return Sky(times, sun, model, level, float(entry["turbidity"]), hours)

    def json(self) -> dict[str, Any]:
        """Write the sky as an object of the glTF extension (format/FORMAT.md).

        Returns:
            JSON-compatible object.
        """
        rows = {name: [list(row) for row in getattr(self, name)] for name in ("sun", "model")}
        hours = {"hours": list(self.hours)} if self.hours else {}
        return {"turbidity": self.turbidity, **hours, "times": list(self.times), "level": list(self.level), **rows}

    def sunlight(self, t: np.ndarray) -> np.ndarray:
        """Interpolate the irradiance of the sun at normal incidence.

        Args:
            t: [...] times in [0, 1].

        Returns:
            [..., 3] linear RGB.
        """
        table = np.asarray(self.sun)
        return np.stack([np.interp(t, self.times, table[:, c]) for c in range(3)], axis=-1)

    def radiance(self, t: float, sun: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Evaluate the radiance of the sky without the sun's disc.

        Args:
            t: Time in [0, 1].
            sun: [3] unit direction to the sun then.
            direction: [..., 3] unit directions, y is up.

        Returns:
            [..., 3] linear RGB; 0 below the horizon.
        """
        k = int(np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2))
        share = np.clip((t - self.times[k]) / (self.times[k + 1] - self.times[k]), 0, 1)
        cosine, height = direction @ np.asarray(sun), direction[..., 1]
        first, second = (evaluate(np.reshape(self.model[j], (3, COEFFICIENTS)), height, cosine) for j in (k, k + 1))
        return np.where(height[..., None] >= 0, np.maximum((1 - share) * first + share * second, 0), 0)


def evaluate(model: np.ndarray, height: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Evaluate the formula of this module.

    Args:
        model: [C, 9] numbers of each colour.
        height: [...] sines of the elevation.
        cosine: [...] cosines of the angle to the sun.

    Returns:
        [..., C] radiance.
    """
    a, b, c, d, e, f, g, h, i = np.moveaxis(np.asarray(model, np.float64), -1, 0)
    up, near = np.maximum(height, 0.0)[..., None], np.clip(cosine, -1, 1)[..., None]
    angle, squared = np.arccos(near), near * near
    glow = (1 + squared) / (1 + h * h - 2 * h * near) ** 1.5
    return (1 + a * np.exp(b / (up + 0.01))) * (c + d * np.exp(e * angle) + f * squared + g * glow + i * np.sqrt(up))


def cell_directions(per_cell: int = PER_CELL) -> np.ndarray:
    """Return points of the cells of the sky.

    Args:
        per_cell: Points of a cell along each axis.

    Returns:
        [ROWS * COLUMNS, per_cell², 3] unit directions; cells row by row from the horizon.
    """
    inner = (np.arange(per_cell) + 0.5) / per_cell
    row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    v, u = (x.ravel() for x in np.meshgrid(inner, inner, indexing="ij"))
    height = (row[:, None] + v) / ROWS
    azimuth = 2 * np.pi * (column[:, None] + u) / COLUMNS
    flat = np.sqrt(1 - height**2)
    return np.stack([flat * np.cos(azimuth), height, flat * np.sin(azimuth)], axis=-1)


@dataclass(frozen=True)
class SkyTables:
    """Daylight at ``STEPS`` times along the path, each divided by its level: 1 reaches a small sphere."""

    sun: np.ndarray
    """[STEPS, 3] float32 irradiance at normal incidence."""
    cells: np.ndarray
    """[STEPS, ROWS * COLUMNS, 3] float32 radiance."""
    level: np.ndarray
    """[STEPS] what sun and cells were divided by, at most about 1."""


@lru_cache(maxsize=4)
def sky_tables(sky: Sky, path: tuple[tuple[float, ...], ...]) -> SkyTables:
    """Tabulate daylight.

    Args:
        sky: The sky.
        path: ``STEPS`` unit directions to the sun, evenly spaced along its path.

    Returns:
        The tables.
    """
    times, directions = np.linspace(0, 1, STEPS), cell_directions()
    cells = np.stack([sky.radiance(t, d, directions).mean(axis=1) for t, d in zip(times, np.asarray(path))])
    sun = sky.sunlight(times)
    level = np.interp(times, sky.times, sky.level)
    scale = 1 / level[:, None]
    return SkyTables((sun * scale).astype(np.float32), (cells * scale[..., None]).astype(np.float32), level)


def light_of_sphere(sun: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Compute the luminance of all light that reaches a small sphere.

    Args:
        sun: [..., 3] irradiance at normal incidence.
        cells: [..., ROWS * COLUMNS, 3] radiance.

    Returns:
        [...] luminance.
    """
    return (sun + 2 * np.pi * cells.mean(axis=-2)) @ LUMINANCE
