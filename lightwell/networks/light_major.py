"""Training rows in light-major order: inputs that depend on the light alone are stored and evaluated once per light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.networks.device import tensor
from lightwell.networks.training import rows_from


@dataclass(frozen=True)
class LightMajorSet:
    """N rows on the device: K lights in random order, R rows each. A batch is a run of whole lights."""

    points: Any
    """[N, 3] places in the grid."""
    pixel: Any
    """[N, G] other inputs of a pixel."""
    frame: Any
    """[K, F] inputs of the light network; F ≥ 1 even without a light, because empty arrays cannot be recorded."""
    target: Any
    """[N, 3] tensor, unit S."""
    weight: Any
    """[N, 1] importance weights with mean 1."""

    @staticmethod
    def of(points: Any, pixel: Any, frame: Any, target: Any, weight: Any) -> LightMajorSet:
        """Bring rows to the device: NumPy arrays are copied, tensors are there.

        Args:
            points: [N, 3] places in the grid.
            pixel: [N, G] other inputs of a pixel.
            frame: [K, F] inputs of the light network.
            target: [N, 3] targets in unit S.
            weight: [N, 1] importance weights.

        Returns:
            The rows on the device.
        """
        columns = (points, pixel, frame, target, weight)
        return LightMajorSet(*(tensor(a) if isinstance(a, np.ndarray) else a for a in columns))

    def __len__(self) -> int:
        return self.points.shape[0]

    @property
    def grain(self) -> int:
        """Rows per light, R: batches start and end between lights."""
        return len(self) // self.frame.shape[0]

    def rows(self, start: Any, count: int) -> tuple[tuple[Any, Any, Any], Any, Any]:
        """Read a batch of neighbouring rows, cyclic.

        Args:
            start: First row, a multiple of R; UInt32 of width 1.
            count: Number of rows, a multiple of R.

        Returns:
            Inputs of ``FactoredNetwork``, targets [count, 3] and weights [count, 1].
        """
        points, pixel, target, weight = (
            rows_from(table, start, count) for table in (self.points, self.pixel, self.target, self.weight)
        )
        frame = rows_from(self.frame, start // self.grain, count // self.grain)
        return (points, pixel, frame), target, weight


def light_runs(light: np.ndarray, most: int = 1 << 10) -> int:
    """Find the largest power of two R such that every R neighbouring rows share a light.

    Args:
        light: [N, 3] light of each row.
        most: Upper limit of R.

    Returns:
        R; it divides N.
    """
    changes = np.flatnonzero((light[1:] != light[:-1]).any(axis=1)) + 1
    found = np.gcd.reduce(np.append(changes, len(light))) if len(light) else 1
    run = 1
    while run < most and found % (2 * run) == 0:
        run *= 2
    return run
