"""Guide selection of a still: alternate passes with and without the guide, to decide which reduces the error faster.

Of two unbiased kinds of passes, the one with the smaller product of variance and time is continued. The passes of the
pilot are part of the image.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter

# Passes of each kind; without a time limit, a pass has one part in PARTS of the image's samples.
PASSES, PARTS = 3, 32
# Samples per pixel from which a still has a pilot.
ENOUGH = 32
# Edge of the squares of pixels that are compared, and share of the noisiest ones that are left out, because single
# bright paths would dominate.
SQUARE, NOISIEST = 4, 0.01
# Squares along an edge of the regions whose mean the variance is relative to: that of a square alone, from a few
# passes, is large exactly where bright paths fell, and would hide them (measured, veach-ajar, two passes: ratio 1.2
# instead of 1.6).
REGION = 5
# Time of a guided pass over that of a plain one where the result must be reproducible (measured: 1.0 to 1.2).
COST = 1.2
# Limits of the measured one: other programs disturb the time of single passes.
COSTS = (0.8, 3.0)
# Relative variance: share of the mean radiance that limits the weight of dark pixels.
DARK = 0.1


class GuideSelector:
    """Passes of both kinds; the key of the dictionaries is whether the guide was used."""

    def __init__(self) -> None:
        """Start without passes."""
        self.pictures: dict[bool, list[np.ndarray]] = {False: [], True: []}
        self.seconds: dict[bool, list[float]] = {False: [], True: []}

    def add(self, guided: bool, channels: np.ndarray, seconds: float) -> None:
        """Add one pass.

        Args:
            guided: Whether the guide was used.
            channels: [H, W, 4 or 5] image block of the pass, see ``radiance_of``.
            seconds: Wall time; the smallest one of a kind counts, because the first pass compiles kernels.
        """
        self.pictures[guided].append(radiance_of(channels))
        self.seconds[guided].append(seconds)

    def guide_pays(self, timed: bool) -> bool:
        """Decide whether guided passes have the smaller product of variance and time.

        Args:
            timed: Whether to use the measured times (not reproducible); if not, ``COST``.

        Returns:
            True when the guide should be used; False with fewer than two passes of a kind.
        """
        return self.gain(timed) > 1

    def gain(self, timed: bool) -> float:
        """Compute variance times time of plain passes over that of guided ones.

        Args:
            timed: Whether to use the measured times (not reproducible); if not, ``COST``.

        Returns:
            Ratio, > 1 where the guide pays; NaN with fewer than two passes of a kind.
        """
        plain, guided = self.variances()
        cost = COST
        if timed and all(self.seconds.values()):
            cost = float(np.clip(min(self.seconds[True]) / max(min(self.seconds[False]), 1e-9), *COSTS))
        return plain / max(guided * cost, 1e-30) if np.isfinite(guided) else float("nan")

    def variances(self) -> tuple[float, float]:
        """Estimate the relative variances of a pass, see ``relative_variances``.

        Returns:
            Variances without and with the guide; NaN with fewer than two passes of a kind.
        """
        if min(len(x) for x in self.pictures.values()) < 2:
            return float("nan"), float("nan")
        return relative_variances(np.array(self.pictures[False]), np.array(self.pictures[True]))

    def forget_guided(self) -> None:
        """Forget the guided passes, because the guide has been trained further."""
        self.pictures[True], self.seconds[True] = [], []


def radiance_of(channels: np.ndarray) -> np.ndarray:
    """Divide the sums of an image block by their weights.

    Args:
        channels: [H, W, 4 or 5] sums: RGB, optional alpha, weight.

    Returns:
        [H, W, 3] radiance; NaN where the weight is 0.
    """
    weight = channels[..., -1:]
    return np.where(weight > 0, channels[..., :3] / np.where(weight > 0, weight, 1), np.nan)


def relative_variances(plain: np.ndarray, guided: np.ndarray) -> tuple[float, float]:
    """Estimate the relative variance of one pass of each kind.

    Pixels are averaged over squares; variance is divided by the squared mean of the region around, and the noisiest
    squares are left out.

    Args:
        plain: [K, H, W, 3] passes without the guide.
        guided: [K, H, W, 3] passes with the guide.

    Returns:
        Relative variances without and with the guide; NaN when no square is finite.
    """
    both = [_squares(x) for x in (plain, guided)]
    mean = 0.5 * (both[0][0] + both[1][0])
    sound = np.isfinite(mean) & np.isfinite(both[0][1]) & np.isfinite(both[1][1])
    if not sound.any():
        return float("nan"), float("nan")
    around = uniform_filter(np.where(sound, mean, 0), REGION, mode="nearest")
    around = around / np.maximum(uniform_filter(sound.astype(np.float64), REGION, mode="nearest"), 1e-9)
    scale = around[sound] ** 2 + (DARK * mean[sound].mean()) ** 2 + 1e-30
    relative = [np.sort(variance[sound] / scale) for _, variance in both]
    kept = max(1, int(len(relative[0]) * (1 - NOISIEST)))
    return float(relative[0][:kept].mean()), float(relative[1][:kept].mean())


def _squares(passes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean over passes and variance of one pass, for squares of pixels; channels are averaged."""
    _, height, width, _ = passes.shape
    rows, columns = height // SQUARE, width // SQUARE
    if not rows or not columns:
        return passes.mean(axis=0).mean(axis=-1), passes.var(axis=0, ddof=1).mean(axis=-1)
    whole = passes[:, : rows * SQUARE, : columns * SQUARE]
    shape = (rows, SQUARE, columns, SQUARE, 3)
    mean, variance = whole.mean(axis=0).reshape(shape), whole.var(axis=0, ddof=1).reshape(shape)
    return mean.mean(axis=(1, 3, 4)), variance.mean(axis=(1, 3, 4))
