"""Statistics of training frames."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass
class TrainingStats:
    """Statistics of one training frame."""

    frame: int = 0
    """Number of the frame."""
    records: int = 0
    """Records used."""
    dropped: int = 0
    """Records discarded because they were not finite."""
    paths: int = 0
    """Training paths."""
    hits: int = -1
    """Training paths that hit a surface with a record; -1: unknown."""
    steps: int = 0
    """Gradient steps."""
    loss: float = float("nan")
    """Mean loss before the steps; NaN without a step."""
    residual: float = 0.0
    """Mean signed difference prediction - target, before the steps, in units of the network."""
    bias: tuple[float, float] = (0.0, float("inf"))
    """Bias estimate: mean of prefix * (traced - cached) over unbiased paths, and its standard error; radiance."""
    bias_paths: int = 0
    """Unbiased paths of that estimate."""
    noise: float = float("nan")
    """Stills: relative variance of one path per pixel, from neighbouring training paths."""
    scale: float = 1.0
    """Radiance scale."""
    changed: bool = False
    """Whether a change of the scene was detected."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Wall time by stage (trace, records, train), seconds."""


def noise_of(luminances: np.ndarray, columns: int, rows: int) -> float:
    """Estimate the relative variance of one path per pixel, within squares of 4 x 4 tiles.

    Args:
        luminances: [rows * columns] luminance over reflectance of the first record of each path; -1: no record.
        columns: Tiles per row.
        rows: Rows of tiles.

    Returns:
        Relative variance; NaN without a complete square.
    """
    whole = luminances.reshape(rows, columns)[: rows // 4 * 4, : columns // 4 * 4]
    groups = whole.reshape(rows // 4, 4, columns // 4, 4).swapaxes(1, 2).reshape(-1, 16).astype(np.float64)
    groups = groups[(groups >= 0).all(axis=1) & np.isfinite(groups).all(axis=1)]
    if not len(groups):
        return float("nan")
    mean = groups.mean(axis=1)
    return float(np.mean(groups.var(axis=1, ddof=1) / (mean**2 + 0.01 * mean.mean() ** 2 + 1e-30)))
