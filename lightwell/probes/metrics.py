"""Measures the error of a probe volume against the reference, and the part of it that is leaked light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.probes.solve import EPSILON, smape

# Light above this multiple of the reference is bright leak; below the second one, dark leak.
BRIGHT, DARK = 1.1, 0.9
# Regularisation of the relative squared error, relative to the mean.
RELATIVE = 0.01


@dataclass(frozen=True)
class Scores:
    """Errors of one method on one set of queries."""

    smape: float
    """Mean symmetric relative error, in [0, 1]."""
    smape_99: float
    """Its 99th percentile."""
    log_psnr: float
    """PSNR of log2(1 + E) with E in units of the mean, dB."""
    rel_mse: float
    """Mean relative squared error."""
    bright: float
    """Bright leak Σ max(Ê - 1.1 E, 0) / Σ Ê, mean over the connected regions."""
    bright_worst: float
    """Bright leak of the worst region."""
    dark: float
    """Dark leak Σ max(0.9 E - Ê, 0) / Σ E, mean over the connected regions."""
    dark_worst: float
    """Dark leak of the worst region."""
    leak_rate: float
    """Fraction of queries with Ê > 2 E."""


def score(truth: np.ndarray, found: np.ndarray, region: np.ndarray) -> Scores:
    """Compare irradiance with the reference.

    Args:
        truth: [N, 3] reference irradiance, linear.
        found: [N, 3] irradiance of the method.
        region: [N] int connected region of each query; negative: not part of the leak scores.

    Returns:
        The scores.
    """
    mean = max(float(truth.mean()), 1e-30)
    error = smape(truth, found, EPSILON * mean)
    t, f = np.log2(1 + truth / mean), np.log2(1 + found / mean)
    noise = max(float(np.mean((t - f) ** 2)), 1e-12)
    parts = [region == k for k in np.unique(region[region >= 0])]
    bright = [_share(np.maximum(found - BRIGHT * truth, 0)[p], found[p]) for p in parts]
    dark = [_share(np.maximum(DARK * truth - found, 0)[p], truth[p]) for p in parts]
    return Scores(
        smape=float(error.mean()),
        smape_99=float(np.quantile(error.mean(axis=1), 0.99)),
        log_psnr=float(10 * np.log10(max(float(t.max()), 1e-6) ** 2 / noise)),
        rel_mse=float(np.mean((truth - found) ** 2 / (truth**2 + RELATIVE * mean**2))),
        bright=float(np.mean(bright)),
        bright_worst=float(np.max(bright)),
        dark=float(np.mean(dark)),
        dark_worst=float(np.max(dark)),
        leak_rate=float((found.sum(axis=1) > 2 * truth.sum(axis=1)).mean()),
    )


def _share(part: np.ndarray, whole: np.ndarray) -> float:
    return float(part.sum() / max(float(whole.sum()), 1e-30))
