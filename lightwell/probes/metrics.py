"""How far a probe volume is from the truth, and how much of it is leak. Arrays are [N, 3] irradiance, linear."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.probes.solve import EPSILON, smape

# Light beyond this share of the truth is bright leak; below that one, dark leak.
BRIGHT, DARK = 1.1, 0.9
# Bound of the relative squared error.
RELATIVE = 0.01


@dataclass(frozen=True)
class Scores:
    """Errors of one method on one set of queries."""

    smape: float
    smape_99: float
    log_psnr: float
    """dB, of log2(1 + E) with E in units of the scene's mean."""
    rel_mse: float
    bright: float
    """Σ max(Ê - 1.1 E, 0) / Σ Ê, mean over the connected regions."""
    bright_worst: float
    """... the worst region."""
    dark: float
    """Σ max(0.9 E - Ê, 0) / Σ E, mean over regions."""
    dark_worst: float
    leak_rate: float
    """Share of queries with Ê > 2 E."""


def score(truth: np.ndarray, found: np.ndarray, region: np.ndarray) -> Scores:
    """Scores of ``found`` against ``truth``; ``region`` [N] int, negative: not counted as leak."""
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
