"""Mottle: blotches of learned light on flat patches, the noise of the reference taken off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.report.metrics import NoiseCorrected, checked

# Percentile of the reference that defines "bright", share of it that is added before the logarithm, share of it above
# which a patch is lit, and standard deviation of the log reference up to which a patch is smooth.
BRIGHT_PERCENTILE, MOTTLE_SHADOW, LIT_SHARE, SMOOTH_SPREAD = 95.0, 0.01, 0.05, 0.15


@dataclass(frozen=True)
class Spread:
    """Root mean square over patches of a spread within a patch."""

    value: float | None
    """None: there is no such patch, or the noise of the reference is larger than what was to be measured."""
    at_most: float | None
    """Upper bound; None where there is no such patch."""


NOTHING = Spread(None, None)


@dataclass(frozen=True)
class Mottle:
    """Blotches: root mean square over patches of the spread of log(learned / reference) within a patch."""

    smooth: Spread
    """Over lit patches whose reference varies little."""
    lit: Spread
    """Over all lit patches."""
    patches: int
    """Number of lit smooth patches."""


def mottle(f: np.ndarray, a: np.ndarray, b: np.ndarray) -> Mottle:
    """Compute the mottle of flat patches under one light.

    With s = 1 % of the 95th percentile of the reference y, it is the variance of log((f + s) / (y + s)) within a patch,
    minus that of the noise of y (a quarter of the variance of log((a + s) / (b + s))). Lit patches have a mean
    reference above 5 % of that percentile; in smooth ones the variance of log(y + s), without noise, is below 0.15².

    Args:
        f: Prediction [P, Q, 3] of P patches of Q points each.
        a: First half of the reference [P, Q, 3].
        b: Second half of the reference [P, Q, 3].

    Returns:
        The mottle of lit smooth patches and of all lit ones.
    """
    f, a, b = (x.mean(axis=-1) for x in checked(prediction=f, half_a=a, half_b=b))
    y = 0.5 * (a + b)
    bright = float(np.percentile(y, BRIGHT_PERCENTILE))
    if bright <= 0:
        return Mottle(NOTHING, NOTHING, 0)
    shadow = MOTTLE_SHADOW * bright
    log_f, log_a, log_b, log_y = (np.log(np.maximum(x, 0) + shadow) for x in (f, a, b, y))
    noise = np.var(log_a - log_b, axis=1, ddof=1) / 4
    error = np.var(log_f - log_y, axis=1, ddof=1) - noise
    lit = y.mean(axis=1) > LIT_SHARE * bright
    smooth = lit & (np.var(log_y, axis=1, ddof=1) - noise < SMOOTH_SPREAD**2)
    return Mottle(_over(smooth, error, noise, y.shape[1]), _over(lit, error, noise, y.shape[1]), int(smooth.sum()))


def _over(patches: np.ndarray, error: np.ndarray, noise: np.ndarray, points: int) -> Spread:
    """Average over some patches of so many points each.

    A sample variance of Q normal values has the standard deviation σ² √(2 / (Q − 1)); two of them are subtracted.
    """
    if not patches.any():
        return Spread(None, None)
    each = np.sqrt(4 / (points - 1)) * noise[patches]
    standard_error = float(np.sqrt((each**2).sum())) / len(each)
    found = NoiseCorrected.of(float(error[patches].mean()), float(noise[patches].mean()), standard_error)
    return Spread(None if found.value is None else float(np.sqrt(found.value)), float(np.sqrt(found.at_most)))
