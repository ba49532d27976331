"""Which node a pixel takes: a dither of its place decides between the two nodes around its value.

All on 32-bit integers, the same in Python and WGSL, so that the choice can be repeated anywhere. The mean over pixels
is unbiased and a gradient of depth shows no bands.
"""

from __future__ import annotations

import numpy as np

from lightwell.lens.families import Family

# 2³² / ρ and 2³² / ρ² of the plastic number ρ; the same turned by a quarter; 2³² / τ and / τ² of its three-
# dimensional sister: steps along x and y for the three axes.
STEPS = ((3242174889, 2447445413), (2447445413, 1052792407), (3518319155, 2882110345))


def pcg(value: np.ndarray) -> np.ndarray:
    """One round of the PCG-RXS-M-XS hash (Jarzynski and Olano 2020) on uint32."""
    with np.errstate(over="ignore"):
        state = value.astype(np.uint32) * np.uint32(747796405) + np.uint32(2891336453)
        word = ((state >> ((state >> np.uint32(28)) + np.uint32(4))) ^ state) * np.uint32(277803737)
        return (word >> np.uint32(22)) ^ word


def uniform(x: np.ndarray, y: np.ndarray, frame: int, axis: int) -> np.ndarray:
    """24 bits in [0, 1) of a pixel, a frame and an axis: float32, evenly spread over any few neighbouring pixels.

    An additive recurrence over the plane (Roberts 2018, the plastic number), shifted by a hash of frame and axis. Its
    choices have little low frequency, so that kernels smooth them away: flat areas are 2 to 7 times less noisy than
    with independent choices.
    """
    along, down = STEPS[axis]
    shift = pcg(np.full(1, frame * 3 + axis, np.uint32))[0]
    with np.errstate(over="ignore"):
        value = x.astype(np.uint32) * np.uint32(along) + y.astype(np.uint32) * np.uint32(down) + shift
    return (value >> np.uint32(8)).astype(np.float32) * np.float32(2.0**-24)


def choose(
    family: Family, radius, second, angle, x, y, frame: int = 0, mode: str = "stochastic"
) -> tuple[np.ndarray, int]:
    """Node of every pixel [n] int64, and how many values were beyond the last node and clamped."""
    index = np.zeros(len(radius), np.int64)
    stride, clamped = 1, 0
    for axis_number, (axis, value) in enumerate(
        ((family.radius, radius), (family.length, second), (family.angle, angle))
    ):
        if len(axis) > 1:
            lower, fraction, over = axis.locate(value)
            threshold = uniform(x, y, frame, axis_number) if mode == "stochastic" else np.float32(0.5)
            index += stride * (lower + (fraction > threshold))
            clamped += over
        stride *= len(axis)
    return index, clamped
