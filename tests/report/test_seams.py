"""Errors beside borders between regions."""

import numpy as np
import pytest

from lightwell.report import borders
from lightwell.report.summary import border_ratio


def halves(columns: int = 40) -> np.ndarray:
    """[20, columns] two regions, left and right."""
    return np.repeat((np.arange(columns) >= columns // 2)[None], 20, axis=0).astype(int)


def test_the_band_is_three_pixels_on_each_side():
    band = borders.border_band(halves())
    assert np.flatnonzero(band[0]).tolist() == list(range(17, 23))
    assert (band == band[0]).all()


def test_no_surface_is_no_region():
    regions = halves()
    regions[:, :20] = -1
    assert not borders.border_band(regions).any()


def test_a_seam_is_found():
    """Twice the error within the band: a ratio of 2."""
    y = np.full((20, 40, 3), 0.99)
    f = y + 0.1
    f[:, 17:23] += 0.1
    found = borders.border_error(f, y, halves())
    assert found.ratio == pytest.approx(2) and found.share == pytest.approx(6 / 40)
    assert borders.border_error(f, y, np.zeros((20, 40), int)) is None


def test_views_are_weighed_by_their_pixels():
    views = [{"border": {"border": 0.2, "interior": 0.1, "share": 0.5}}, {"border": None}]
    assert border_ratio(views) == pytest.approx(2)
    assert border_ratio([{"border": None}]) is None
