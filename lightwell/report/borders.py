"""Errors of a picture beside borders between regions, such as those of experts: visible seams."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from lightwell.report.metrics import relative_errors

# Pixels on each side of a border between regions that belong to it.
BORDER_WIDTH = 3


@dataclass(frozen=True)
class BorderError:
    """Mean relative error near the borders between regions, and away from them."""

    border: float
    interior: float
    share: float
    """Share of the pixels with a surface that are near a border."""

    @property
    def ratio(self) -> float:
        """Border over interior error: 1 when no seam is visible."""
        return self.border / self.interior


def border_band(regions: np.ndarray, width: int = BORDER_WIDTH) -> np.ndarray:
    """Find the pixels near a border between two regions.

    Args:
        regions: Region of every pixel [height, width], integers; negative where there is no surface.
        width: Largest distance from a border, pixels.

    Returns:
        Whether a pixel is near a border [height, width].
    """
    surface = regions >= 0
    edge = np.zeros(regions.shape, bool)
    for here, there in ((np.s_[1:, :], np.s_[:-1, :]), (np.s_[:, 1:], np.s_[:, :-1])):
        differs = (regions[here] != regions[there]) & surface[here] & surface[there]
        edge[here] |= differs
        edge[there] |= differs
    if not edge.any():
        return edge
    return np.asarray(distance_transform_edt(~edge) < width) & surface


def border_error(f: np.ndarray, y: np.ndarray, regions: np.ndarray) -> BorderError | None:
    """Compute the errors of a picture near and away from borders.

    Args:
        f: Prediction [height, width, 3].
        y: Reference [height, width, 3].
        regions: Region of every pixel [height, width], integers; negative where there is no surface.

    Returns:
        The errors; None unless there are pixels of both kinds.
    """
    errors, band = relative_errors(f, y), border_band(regions)
    interior = (regions >= 0) & ~band
    if not band.any() or not interior.any() or not errors[interior].mean() > 0:
        return None
    share = band.sum() / (band.sum() + interior.sum())
    return BorderError(float(errors[band].mean()), float(errors[interior].mean()), float(share))
