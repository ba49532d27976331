"""Training rows in light-major order: what depends on the light alone is stored, and computed, once per light."""

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
    """[K, F] inputs of the light network; F ≥ 1 even where there is none, because empty arrays cannot be recorded."""
    target: Any
    """[N, 3] tensor, unit S."""
    weight: Any
    """[N, 1] importance weights with mean 1."""

    @staticmethod
    def from_numpy(points, pixel, frame, target, weight) -> LightMajorSet:
        """Copy to the device, once."""
        return LightMajorSet(*(tensor(a) for a in (points, pixel, frame, target, np.reshape(weight, (-1, 1)))))

    def __len__(self) -> int:
        return self.points.shape[0]

    @property
    def grain(self) -> int:
        """R: batches start and end between lights."""
        return len(self) // self.frame.shape[0]

    def rows(self, start: Any, count: int) -> tuple[tuple[Any, Any, Any], Any, Any]:
        """``count`` rows from row ``start`` on, round the end: inputs of ``FactoredNetwork``, targets, weights."""
        points, pixel, target, weight = (
            rows_from(table, start, count) for table in (self.points, self.pixel, self.target, self.weight)
        )
        frame = rows_from(self.frame, start // self.grain, count // self.grain)
        return (points, pixel, frame), target, weight


def light_runs(light: np.ndarray, most: int = 1 << 10) -> int:
    """Largest power of two R ≤ ``most`` such that every R neighbouring rows of [N, 3] share a light; N a multiple."""
    changes = np.flatnonzero((light[1:] != light[:-1]).any(axis=1)) + 1
    found = np.gcd.reduce(np.append(changes, len(light))) if len(light) else 1
    run = 1
    while run < most and found % (2 * run) == 0:
        run *= 2
    return run
