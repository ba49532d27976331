"""The pilot of a still: passes with and without the guide in turns, to see which kind brings the picture on faster.

Effort is variance times time: of two kinds of passes with one mean, that with the smaller product goes on. What was
rendered to find out stays in the picture.
"""

from __future__ import annotations

from typing import Any

import numpy as np

# Passes of each kind, and parts of a picture's samples that one of them has where no clock runs.
PASSES, PARTS = 3, 32
# Samples per pixel from which a still has a pilot.
ENOUGH = 32
# Edge of the squares of pixels that are compared, and the share of the noisiest that does not count: single bright
# paths would decide.
SQUARE, NOISIEST = 4, 0.01
# Time of a guided pass over that of a plain one, where no clock may decide (measured: 1.0 to 1.2).
COST = 1.2
# Relative variance: share of the mean radiance below which errors of dark places count less.
DARK = 0.1


class Pilot:
    """Collects passes of two kinds; ``guided`` is the key."""

    def __init__(self) -> None:
        self.pictures: dict[bool, list[np.ndarray]] = {False: [], True: []}
        self.seconds: dict[bool, list[float]] = {False: [], True: []}

    def add(self, guided: bool, block: Any, seconds: float) -> None:
        """Take in an image block of one pass and its time; the least counts, because the first makes kernels."""
        self.pictures[guided].append(radiance_of(np.array(block.tensor())))
        self.seconds[guided].append(seconds)

    def guide_pays(self, timed: bool) -> bool:
        """Whether guided passes need less variance times time; ``timed``: by the clock, or by ``COST``."""
        if min(len(x) for x in self.pictures.values()) < 2:
            return False
        plain, guided = efforts(np.array(self.pictures[False]), np.array(self.pictures[True]))
        cost = min(self.seconds[True]) / max(min(self.seconds[False]), 1e-9) if timed else COST
        return guided * cost < plain


def radiance_of(channels: np.ndarray) -> np.ndarray:
    """[H, W, 3] of a block's sums [H, W, 4 or 5], whose last channel is the weight; NaN where there is none."""
    weight = channels[..., -1:]
    return np.where(weight > 0, channels[..., :3] / np.where(weight > 0, weight, 1), np.nan)


def efforts(plain: np.ndarray, guided: np.ndarray) -> tuple[float, float]:
    """Relative variance of passes [K, H, W, 3] of both kinds: that of squares of pixels over their squared mean,
    without the noisiest squares; NaN where there is nothing to compare."""
    both = [_squares(x) for x in (plain, guided)]
    mean = 0.5 * (both[0][0] + both[1][0])
    sound = np.isfinite(mean) & np.isfinite(both[0][1]) & np.isfinite(both[1][1])
    if not sound.any():
        return float("nan"), float("nan")
    scale = mean[sound] ** 2 + (DARK * mean[sound].mean()) ** 2 + 1e-30
    told = [np.sort(variance[sound] / scale) for _, variance in both]
    kept = max(1, int(len(told[0]) * (1 - NOISIEST)))
    return float(told[0][:kept].mean()), float(told[1][:kept].mean())


def _squares(passes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of one pass by squares of pixels, channels averaged."""
    _, height, width, _ = passes.shape
    rows, columns = height // SQUARE, width // SQUARE
    if not rows or not columns:
        return tuple(x.mean(axis=-1) for x in (passes.mean(axis=0), passes.var(axis=0, ddof=1)))
    whole = passes[:, : rows * SQUARE, : columns * SQUARE]
    pool = lambda x: x.reshape(rows, SQUARE, columns, SQUARE, 3).mean(axis=(1, 3, 4))  # noqa: E731
    return pool(whole.mean(axis=0)), pool(whole.var(axis=0, ddof=1))
