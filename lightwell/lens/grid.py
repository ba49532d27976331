"""Axes of a library, and the nodes around a value.

A node is one kernel. Its index is (i_angle · N_length + i_length) · N_radius + i_radius, "length" being the second axis
of the family. A value lies between two nodes of its axis; the fraction between them is the weight of the upper one.
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
# Radius below which the picture is left unchanged, pixels; lengths below twice this.
THRESHOLD = 0.5


@dataclass(frozen=True)
class Axis:
    """Node values of one axis, ascending."""

    name: str
    values: tuple[float, ...]

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def _array(self) -> np.ndarray:
        return np.asarray(self.values, np.float64)

    def locate(self, value: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
        """Find the nodes around values.

        Args:
            value: Values [n]; clamped to the range of the axis.

        Returns:
            Lower node [n] int32, weight of the upper node [n] float32 in [0, 1], and the number of values beyond the
            last node.
        """
        nodes = self._array
        if len(nodes) == 1:
            return np.zeros(value.shape, np.int32), np.zeros(value.shape, np.float32), 0
        position = np.interp(value, nodes, np.arange(len(nodes)))
        lower = np.minimum(position.astype(np.int32), len(nodes) - 2)
        return lower, (position - lower).astype(np.float32), int((value > nodes[-1]).sum())


def radius_axis(largest: float, noise: float, finest: float = FINEST) -> Axis:
    """Make the radius axis: 0, then ``THRESHOLD`` to ``largest`` with steps that keep the dither noise near ``noise``.

    Args:
        largest: Largest radius, pixels.
        noise: Noise of flat areas by a random choice between neighbouring nodes, relative.
        finest: Smallest step, pixels.

    Returns:
        The axis.
    """
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
    """Make the axis of motion lengths: 0, then lengths ℓ with steps ``step`` · (1 + ℓ/2)^0.6, as for a radius of ℓ/2.

    Args:
        largest: Longest motion, pixels.
        step: Step at short lengths, pixels.

    Returns:
        The axis.
    """
    values = [0.0, 2 * THRESHOLD]
    while values[-1] < largest:
        values.append(round(values[-1] + step * (1 + values[-1] / 2) ** CAP_POWER, 3))
    return Axis("length", tuple(values))


def uniform_axis(name: str, first: float, last: float, count: int) -> Axis:
    """Make an axis of evenly spaced nodes.

    Args:
        name: Name of the axis.
        first: First value.
        last: Last value.
        count: Number of nodes, ≥ 1.

    Returns:
        The axis.
    """
    return Axis(name, tuple(float(v) for v in np.linspace(first, last, count)))
