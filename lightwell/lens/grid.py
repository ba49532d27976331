"""Axes of a library and the way back from a value to its nodes.

A node is one kernel. Its index is (i_angle · N_length + i_length) · N_radius + i_radius, "length" being the second axis
of the family. A value falls between two nodes of its axis; the fraction between them is the weight of the upper one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

# Distance of neighbouring kernels half a step off is about FIT · step^0.85 / √r (relative L2, measured), so that a
# random choice between two nodes makes flat areas noisy by σ = FIT/√π · step^0.85 / r^1.5.
FIT, FIT_POWER = 0.65, 0.85
# Steps never exceed CAP · r^0.6, which holds the distance itself, nor fall below FINEST pixels.
CAP, CAP_POWER, FINEST = 0.25, 0.6, 0.02
# Smallest radius and length that are not passed through unchanged, pixels.
THRESHOLD = 0.5


@dataclass(frozen=True)
class Axis:
    """Ascending node values."""

    name: str
    values: tuple[float, ...]

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def _array(self) -> np.ndarray:
        return np.asarray(self.values, np.float64)

    def locate(self, value: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
        """Lower node [n] int32, weight of the upper one [n] float32 in [0, 1), and how many lay past the last node."""
        nodes = self._array
        if len(nodes) == 1:
            return np.zeros(value.shape, np.int32), np.zeros(value.shape, np.float32), 0
        position = np.interp(value, nodes, np.arange(len(nodes)))
        lower = np.minimum(position.astype(np.int32), len(nodes) - 2)
        return lower, (position - lower).astype(np.float32), int((value > nodes[-1]).sum())


def radius_axis(largest: float, noise: float, finest: float = FINEST) -> Axis:
    """0, then from ``THRESHOLD`` to ``largest`` px with steps that keep the noise of a random choice near ``noise``."""
    values = [0.0, THRESHOLD]
    while values[-1] < largest:
        r = values[-1]
        step = (noise * np.sqrt(np.pi) * r**1.5 / FIT) ** (1 / FIT_POWER)
        step = min(max(step, finest), max(CAP * r**CAP_POWER, finest))
        values.append(round(float(r + step), 3))
    values[-1] = max(float(largest), THRESHOLD)
    if len(values) > 3 and values[-1] - values[-2] < 0.4 * (values[-2] - values[-3]):
        del values[-2]
    return Axis("radius", tuple(values))


def length_axis(largest: float, step: float) -> Axis:
    """0, then lengths with steps ``step`` · (1 + ℓ/2)^0.6, the radius law on ℓ/2."""
    values = [0.0, 2 * THRESHOLD]
    while values[-1] < largest:
        values.append(round(values[-1] + step * (1 + values[-1] / 2) ** CAP_POWER, 3))
    return Axis("length", tuple(values))


def uniform_axis(name: str, first: float, last: float, count: int) -> Axis:
    """Evenly spaced nodes."""
    return Axis(name, tuple(float(v) for v in np.linspace(first, last, count)))
