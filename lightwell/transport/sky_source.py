"""Sun and sky of a clear day as a light source of the path tracer, one time of day per lane.

What a rasteriser draws of it is the sun with its shadow. The sky's light is learned whole, also what reaches a surface
in a straight line (``first_hit``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lightwell.backend import dr, mi, upload_floats
from lightwell.core.color import LUMINANCE
from lightwell.scenes.sky import COLUMNS, ROWS, STEPS
from lightwell.scenes.variables import Sun
from lightwell.transport.panes import Panes

# Share of the directions that are chosen to the sun.
TO_SUN = 0.5
# Solid angle of a cell of the sky, steradian.
SOLID_ANGLE = 2 * np.pi / (ROWS * COLUMNS)
CELLS = ROWS * COLUMNS


def cell_of(direction: mi.Vector3f) -> mi.UInt32:
    """Find the cell of the sky in directions above the horizon.

    Args:
        direction: [N] unit directions, y is up.

    Returns:
        [N] numbers of cells.
    """
    row = mi.UInt32(dr.clip(direction.y * ROWS, 0, ROWS - 1))
    turn = dr.atan2(direction.z, direction.x) * dr.inv_two_pi
    turn = dr.select(turn < 0, turn + 1, turn)
    return row * COLUMNS + mi.UInt32(dr.clip(turn * COLUMNS, 0, COLUMNS - 1))


@dataclass
class DayEmitter:
    """Sun and sky, each divided by the level of its time: together 1 reaches a small sphere."""

    direction: mi.Vector3f
    """To the sun."""
    sun: mi.Color3f
    """Its irradiance at normal incidence."""
    step: mi.UInt32
    """Step of the tables, below ``STEPS``."""
    level: mi.Float
    """Brightness relative to the brightest time of the day."""
    cells: mi.Float
    """[STEPS * CELLS * 3] radiance of the sky."""
    sums: mi.Float
    """[STEPS * CELLS] cumulated probability of the cells."""
    panes: Panes | None = None
    hits = True
    emits = False
    first_hit = True

    @staticmethod
    def of(variable: Sun, direction: mi.Vector3f, panes: Panes | None = None) -> DayEmitter:
        """Make the source of a sun with a sky.

        Args:
            variable: The sun.
            direction: [N] directions to it, unit.
            panes: What its sun passes.

        Returns:
            The source.
        """
        sun, level, cells, sums = _device_tables(variable)
        place = _time(variable, direction) * (STEPS - 1)
        step = mi.UInt32(dr.round(place))
        color = mi.Color3f(*(dr.gather(mi.Float, sun, step * 3 + c) for c in range(3)))
        # In twilight the light grows by a fifth from one step to the next.
        before = mi.UInt32(dr.clip(dr.floor(place), 0, STEPS - 2))
        ends = (dr.gather(mi.Float, level, before + k) for k in (0, 1))
        return DayEmitter(direction, color, step, dr.lerp(*ends, place - mi.Float(before)), cells, sums, panes)

    def sky(self, direction: mi.Vector3f, active: mi.Bool) -> mi.Color3f:
        """Evaluate the sky.

        Args:
            direction: [N] unit directions.
            active: [N] lanes.

        Returns:
            [N] radiance, 0 below the horizon.
        """
        active = active & (direction.y > 0)
        at = (self.step * CELLS + cell_of(direction)) * 3
        return mi.Color3f(*(dr.gather(mi.Float, self.cells, at + c, active) for c in range(3)))

    def sample(self, scene: mi.Scene, si: mi.SurfaceInteraction3f, u: mi.Point2f, active: mi.Bool):
        """Sample a direction to the sun or to the sky.

        Args:
            scene: Mitsuba scene, not used.
            si: Surface interactions to light.
            u: 2D points in [0, 1)².
            active: Active lanes.

        Returns:
            Direction [world], weight, density per solid angle, whether it is a delta density (the sun), shadow ray.
        """
        to_sun = u.x < TO_SUN
        number = (u.x - TO_SUN) / (1 - TO_SUN)
        first = self.step * CELLS
        below = lambda k: dr.gather(mi.Float, self.sums, first + k, active) <= number  # noqa: E731
        cell = dr.binary_search(0, CELLS - 1, below)
        before = dr.select(cell > 0, dr.gather(mi.Float, self.sums, first + dr.maximum(cell, 1) - 1, active), 0)
        share = dr.gather(mi.Float, self.sums, first + cell, active) - before
        # What is left of the number places the direction within its cell.
        inner = dr.clip((number - before) / share, 0, 1 - 1e-6)
        height = (mi.Float(cell // COLUMNS) + inner) / ROWS
        sine, cosine = dr.sincos(dr.two_pi * (mi.Float(cell % COLUMNS) + u.y) / COLUMNS)
        flat = dr.safe_sqrt(1 - height * height)
        d = dr.select(to_sun, self.direction, mi.Vector3f(flat * cosine, height, flat * sine))
        pdf = (1 - TO_SUN) * share / SOLID_ANGLE
        at = (first + cell) * 3
        radiance = mi.Color3f(*(dr.gather(mi.Float, self.cells, at + c, active) for c in range(3)))
        weight = dr.select(to_sun, self.sun / TO_SUN, dr.select(share > 0, radiance / pdf, 0))
        return d, weight, dr.select(to_sun, 1, pdf), to_sun, si.spawn_ray(d)

    def hit(
        self,
        scene: mi.Scene,
        prev: mi.Interaction3f,
        si: mi.SurfaceInteraction3f,
        ray: mi.Ray3f,
        delta_prev: mi.Bool,
        active: mi.Bool,
    ) -> tuple[mi.Spectrum, mi.Float]:
        """Find the sky in rays that leave the scene; the sun is never met.

        Args:
            scene: Mitsuba scene, not used.
            prev: Interactions that the rays come from, not used.
            si: Surface interactions that the rays found.
            ray: Rays, chosen by BSDF sampling.
            delta_prev: Whether a delta lobe chose the ray.
            active: Active lanes.

        Returns:
            Radiance, and the density with which ``sample`` chooses the direction (0 after a delta lobe).
        """
        free = active & ~si.is_valid() & (ray.d.y > 0)
        cell = cell_of(ray.d)
        at = self.step * CELLS + cell
        before = dr.select(cell > 0, dr.gather(mi.Float, self.sums, dr.maximum(at, 1) - 1, free), 0)
        pdf = (1 - TO_SUN) * (dr.gather(mi.Float, self.sums, at, free) - before) / SOLID_ANGLE
        return self.sky(ray.d, free), dr.select(delta_prev, 0, pdf)


def _time(variable: Sun, direction: mi.Vector3f) -> mi.Float:
    """``Sun.time`` on the device."""
    center, radius, other, half, full = variable.circle
    way = direction - mi.Vector3f(*map(float, center))
    angle = dr.atan2(dr.dot(way, mi.Vector3f(*map(float, other))), dr.dot(way, mi.Vector3f(*map(float, radius))))
    angle = dr.select(angle < 0, angle + dr.two_pi, angle)
    angle = dr.select(angle > float(full + np.pi - full / 2), 0, dr.minimum(angle, float(full)))
    late = 0.5 + (angle - float(half)) / float(2 * (full - half))
    return dr.clip(dr.select(angle < float(half), angle / float(2 * half), late), 0, 1)


@lru_cache(maxsize=2)
def _device_tables(variable: Sun) -> tuple[mi.Float, mi.Float, mi.Float, mi.Float]:
    tables = variable.tables
    weight = tables.cells @ np.asarray(LUMINANCE) + 1e-12
    sums = np.cumsum(weight / weight.sum(axis=1, keepdims=True), axis=1)
    sums /= sums[:, -1:]
    found = tuple(upload_floats(table.ravel()) for table in (tables.sun, tables.level, tables.cells, sums))
    dr.eval(found)
    return found
