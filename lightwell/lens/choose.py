"""Choose the node of every pixel: a dither between the two nodes around its value.

All arithmetic is on 32-bit integers, the same in Python and WGSL, so that the choice can be repeated anywhere. The
mean over pixels is unbiased and a gradient of depth shows no bands.
"""

from __future__ import annotations

import numpy as np

from lightwell.lens.families import Family

# Steps along x and y for the three axes: 2³² / ρ and 2³² / ρ² of the plastic number ρ; the same rotated by 90°; 2³² / τ
# and 2³² / τ² of its three-dimensional counterpart τ.
STEPS = ((3242174889, 2447445413), (2447445413, 1052792407), (3518319155, 2882110345))


def pcg(value: np.ndarray) -> np.ndarray:
    """Apply one round of the PCG-RXS-M-XS hash.

    Args:
        value: Integers of any shape, taken as uint32.

    Returns:
        Hashes, uint32, same shape.

    Reference: Jarzynski, Olano, *Hash Functions for GPU Rendering*, JCGT 9(3), 2020.
    """
    with np.errstate(over="ignore"):
        state = value.astype(np.uint32) * np.uint32(747796405) + np.uint32(2891336453)
        word = ((state >> ((state >> np.uint32(28)) + np.uint32(4))) ^ state) * np.uint32(277803737)
        return (word >> np.uint32(22)) ^ word


def uniform(x: np.ndarray, y: np.ndarray, frame: int, axis: int) -> np.ndarray:
    """Generate low-discrepancy dither values for pixels, a frame and an axis.

    An additive recurrence over the plane (the R2 sequence of the plastic number), shifted by a hash of frame and axis.
    It has little low-frequency content, so that kernels smooth it away: flat areas are 2 to 7 times less noisy than
    with independent random choices.

    Args:
        x: Integer x of the pixels [n].
        y: Integer y of the pixels [n].
        frame: Frame number.
        axis: Axis of the family, 0 to 2.

    Returns:
        24-bit values in [0, 1), float32 [n].

    Reference: Roberts, *The Unreasonable Effectiveness of Quasirandom Sequences*, 2018.
    """
    along, down = STEPS[axis]
    # Frames before the first have negative numbers; WGSL wraps them around as well.
    shift = pcg(np.full(1, (frame * 3 + axis) & 0xFFFFFFFF, np.uint32))[0]
    with np.errstate(over="ignore"):
        value = x.astype(np.uint32) * np.uint32(along) + y.astype(np.uint32) * np.uint32(down) + shift
    return (value >> np.uint32(8)).astype(np.float32) * np.float32(2.0**-24)


def choose(
    family: Family,
    radius: np.ndarray,
    second: np.ndarray,
    angle: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    frame: int = 0,
    mode: str = "stochastic",
) -> tuple[np.ndarray, int]:
    """Choose the node of every pixel.

    Args:
        family: Family of kernels.
        radius: Magnitude of the circle of confusion [n], pixels.
        second: Value on the second axis [n]: length of the motion in pixels, or field radius in [0, 1].
        angle: Angle of the motion [n], radians in [0, π].
        x: Integer x of the pixels [n].
        y: Integer y of the pixels [n].
        frame: Frame number, for the dither.
        mode: ``stochastic`` (dithered) or ``nearest``.

    Returns:
        Node of every pixel [n] int64, and the number of values that were beyond the last node and clamped.
    """
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
