"""A leak that the noise of the reference hides is told as a bound."""

from types import SimpleNamespace

import numpy as np
import pytest

from lightwell.baking.quality import score_quality
from lightwell.report.verdict import verdict

POINTS = 400
# What pictures of the field would score.
SEEN = {"psnr_db": 40.0, "flip": 0.03, "mottle": 0.01}


def leak_of(spike: float, learned: float):
    """Figures of a field at points of which a quarter is dark, for a reference with one bright path in half B."""
    a, b, f = np.ones((3, POINTS, 3))
    a[:100] = b[:100] = 0.05
    b[7] += spike
    f[:100] = learned
    light, weight = np.zeros((POINTS, 3)), np.ones(POINTS)
    points = SimpleNamespace(points=None, light=light, half_a=a, half_b=b, weight=weight)
    return score_quality(SimpleNamespace(pictures=[], patches=None, points=points), lambda points, light: f)


def test_one_bright_path_is_not_a_leak():
    figures = leak_of(20.0, 0.05)
    assert figures.leak > 0.1
    assert figures.bounds["leak"] == pytest.approx(3 * figures.leak, rel=1e-6)
    judged = verdict(figures.json() | SEEN, bounds=figures.bounds)
    assert "leak" in judged.text and "not measurable" in judged.text
    assert judged.level == "fair" and "glow" not in judged.text


def test_a_leak_above_the_noise_stays_one():
    figures = leak_of(0.0, 0.2)
    assert figures.leak > 0.1 and "leak" not in figures.bounds
    assert "dark places glow" in verdict(figures.json() | SEEN, bounds=figures.bounds).text
