"""Sums over the rays of points: rows of ``radiosity`` times the light of bins, on the device.

Notation: N points, P rays per point, F bins, K lights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.backend import aligned, dr, mi, upload_floats, upload_integers
from lightwell.scenes.executor import Recipe
from lightwell.transport.radiosity import Radiosity, Rows, row_launches
from lightwell.transport.samples import SurfacePoints


@dataclass(frozen=True)
class DeviceRows:
    """What N points see of the bins, on the device."""

    bin: mi.UInt32
    """[N * P] bins."""
    weight: mi.Float16
    """[N * P * 3] weights."""
    rays: int
    """P."""

    @staticmethod
    def of(rows: Rows) -> DeviceRows:
        """Copy rows to the device.

        Args:
            rows: What N points see.

        Returns:
            The rows.
        """
        weight = mi.Float16(aligned(rows.weight.ravel(), np.float16))
        return DeviceRows(upload_integers(rows.bin.ravel()), weight, rows.bin.shape[1])

    @staticmethod
    def traced(
        radiosity: Radiosity, points: SurfacePoints, rays: int, seed: int, sky: bool, recipe: Recipe | None = None
    ) -> DeviceRows:
        """Trace what points see, as ``Radiosity.rows``; rows that are traced here are not copied.

        Args:
            radiosity: Bins of the scene.
            points: N surface points.
            rays: P, rays per point, even.
            seed: Seed of the rays.
            sky: Note the cell of the sky of rays that leave the scene.
            recipe: How workers make points and bins again; None: they are sent.

        Returns:
            The rows.
        """
        scene, size = radiosity.scene, len(points) * rays
        if scene.executor is not None:
            return DeviceRows.of(radiosity.rows(points, rays, seed, sky, recipe))
        found, weight = dr.empty(mi.UInt32, size), dr.empty(mi.Float16, 3 * size)
        for part, w, index in row_launches(scene, radiosity.bins, points, rays, seed, sky=sky):
            at = dr.arange(mi.UInt32, (part.stop - part.start) * rays) + dr.opaque(mi.UInt32, part.start * rays)
            dr.scatter(found, index, at)
            for c, values in enumerate(w):
                # One kernel writes all three.
                dr.scatter(weight, mi.Float16(values), 3 * at + c, mode=dr.ReduceMode.Permute)
            dr.eval(found, weight)
        return DeviceRows(found, weight, rays)


class Gather:
    """Rows and bin light on the device: halves of samples for pairs of point and light."""

    def __init__(self, rows: DeviceRows, irradiance: np.ndarray) -> None:
        """Upload the light of the bins.

        Args:
            rows: What N points see.
            irradiance: [K, F + 1, 3] irradiance of the bins under K lights, as in ``BinLight``.
        """
        self._rows = rows
        self._irradiance, self._bins = upload_floats(irradiance.ravel()), irradiance.shape[1]

    def __call__(self, point: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Two half means [pairs, 3] of the radiance that leaves ``point`` [pairs] under ``light`` [pairs], by index."""
        halves = _sum_of_rays(
            upload_integers(point),
            upload_integers(light),
            (self._rows.bin, self._rows.weight, self._irradiance),
            tuple(dr.opaque(mi.UInt32, v) for v in (self._rows.rays, self._bins)),
        )
        dr.eval(halves)
        return tuple(np.ascontiguousarray(np.array(h).T) for h in halves)


@dr.syntax
def _sum_of_rays(point, light, held, sizes):
    """Radiance of both halves of the rays of each pair."""
    bin_of, weight, irradiance = held
    rays, bins = sizes
    a, b = mi.Color3f(0), mi.Color3f(0)
    k = mi.UInt32(0)
    begin, half, first = point * rays, rays // 2, light * bins
    while dr.hint(k < rays, label="lightwell gather"):
        entry = begin + k
        index = dr.gather(mi.UInt32, bin_of, entry)
        # The last bin is dark.
        lit = index + 1 < bins
        E = dr.gather(mi.Color3f, irradiance, first + index, lit)
        w = mi.Color3f(*(mi.Float(dr.gather(mi.Float16, weight, entry * 3 + c)) for c in range(3)))
        value = dr.select(lit, w * E, 0)
        a += dr.select(k < half, value, 0)
        b += dr.select(k < half, 0, value)
        k += 1
    return a, b
