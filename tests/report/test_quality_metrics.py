"""Noise-free PSNR, mottle and leak on made-up data whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.core.color import display
from lightwell.report import metrics, picture_metrics
from lightwell.report.mottle import mottle


def halves(truth: np.ndarray, noise: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Two noisy copies of a truth."""
    random = np.random.default_rng(seed)
    return tuple(truth * (1 + noise * random.standard_normal(truth.shape)) for _ in range(2))


def test_psnr_without_noise_is_that_of_a_clean_reference():
    truth = np.full((200, 200, 3), 0.25)
    f = truth * 1.05
    a, b = halves(truth, 0.04)
    clean = picture_metrics.psnr_db(f, truth)
    assert picture_metrics.psnr_noise_free(f, a, b).db == pytest.approx(clean, abs=0.3)
    assert picture_metrics.psnr_db(f, 0.5 * (a + b)) < clean - 0.8


def test_psnr_of_paths_with_heavy_tails_is_not_that_of_their_darker_pictures():
    truth = np.random.default_rng(3).uniform(0.05, 0.5, (200, 200, 1)) * np.ones(3)
    random = np.random.default_rng(4)
    a, b = (truth * random.gamma(3, 1 / 3, truth.shape) for _ in range(2))
    clean = picture_metrics.psnr_db(1.08 * truth, truth)
    assert picture_metrics.psnr_noise_free(1.08 * truth, a, b, truth).db == pytest.approx(clean, abs=2.0)
    # The mean over displayed halves, which noise darkens.
    f, a, b = (display(x) for x in (1.08 * truth, a, b))
    assert -10 * np.log10(np.mean((f - a) * (f - b))) < clean - 5


def test_exposure_unit_ignores_highlights_and_black():
    picture = np.full((100, 100, 3), 2.0)
    picture[:50] = 0
    picture[99, :10] = 1e4
    assert picture_metrics.exposure_unit(picture) == pytest.approx(8.0, rel=0.05)
    assert picture_metrics.exposure_unit(np.zeros((4, 4, 3))) is None


def patches(spread: float, seed: int = 1) -> np.ndarray:
    """[300, 9, 3] factors with a log-normal spread inside each patch."""
    return np.exp(spread * np.random.default_rng(seed).standard_normal((300, 9, 1))) * np.ones(3)


def test_mottle_finds_the_spread_of_blotches_and_not_the_noise():
    truth = np.random.default_rng(2).uniform(0.5, 2, (300, 1, 1)) * np.ones((300, 9, 3))
    a, b = halves(truth, 0.05)
    assert mottle(truth * patches(0.1), a, b).smooth.value == pytest.approx(0.1, rel=0.1)
    assert mottle(truth, a, b).smooth.at_most < 0.02


def test_mottle_and_psnr_that_the_noise_hides_are_bounds():
    truth = np.full((60, 9, 3), 1.0)
    a, b = halves(truth, 0.3)
    found = mottle(truth * patches(0.02)[:60], a, b).smooth
    assert found.value is None and 0.02 < found.at_most < 0.2
    picture = np.full((200, 200, 3), 0.25)
    hidden = picture_metrics.psnr_noise_free(picture * 1.0005, *halves(picture, 0.2))
    assert hidden.is_lower_bound and 35 < hidden.db < picture_metrics.psnr_db(picture * 1.0005, picture)
    seen = picture_metrics.psnr_noise_free(picture * 1.05, *halves(picture, 0.02))
    assert not seen.is_lower_bound
    exact = picture_metrics.psnr_noise_free(picture, picture, picture)
    assert exact.db == picture_metrics.MAX_PSNR_DB and not exact.is_lower_bound


def test_a_wrong_level_is_no_mottle():
    truth = np.ones((50, 9, 3))
    assert mottle(2 * truth, truth, truth).smooth.value == pytest.approx(0, abs=1e-9)


def test_mottle_of_smooth_patches_leaves_out_shadow_edges_and_the_dark():
    truth = np.ones((60, 9, 3))
    truth[:20, :4] = 0.2
    truth[20:40] = 1e-3
    f = truth.copy()
    f[:40, ::2] *= 3
    found = mottle(f, truth, truth)
    assert found.patches == 20 and found.smooth.value == pytest.approx(0, abs=1e-9)
    assert found.lit.value > 0.2


def test_leak_is_the_light_in_the_dark_quarter():
    truth = np.ones((100, 3))
    truth[:25] = 0
    f = truth.copy()
    f[:25] = 0.03
    assert metrics.leak(f, truth, truth) == pytest.approx(0.03 / 0.75)
    assert metrics.leak(truth * 2, truth, truth) == pytest.approx(0)


def test_missing_light_counts_as_leak():
    truth = np.ones((100, 3))
    truth[:25] = 0.1
    f = truth.copy()
    f[:25] = 0
    assert metrics.leak(f, truth, truth) == pytest.approx(0.1 / 0.775)


def test_one_bright_path_of_the_reference_is_noise_of_the_leak():
    a, b = np.ones((2, 400, 3))
    a[:100] = b[:100] = 0.05
    assert metrics.leak_noise(a, b) == 0
    # 100 dark points: one that is 20 brighter in half B adds 0.2 to their mean.
    b[7] += 20
    assert metrics.leak(a, a, b) == pytest.approx(metrics.leak_noise(a, b))
    assert metrics.leak(a, a, b) > 0.2


def test_noise_of_the_leak_is_its_standard_error():
    random = np.random.default_rng(3)
    truth = np.where(np.arange(400)[:, None] < 100, 0.1, 1.0) * np.ones((400, 3))
    # Half A is exact, so that B - A is the noise of B alone: 0.02 per point.
    found = [truth + 0.02 * random.standard_normal((400, 1)) for _ in range(300)]
    leaks = np.array([metrics.leak(truth, truth, b) for b in found])
    errors = np.array([metrics.leak_noise(truth, b) for b in found])
    # The root mean square of 300 draws is known to 4 %.
    assert np.sqrt(np.square(leaks).mean()) == pytest.approx(errors.mean(), rel=0.16)
    assert (leaks < metrics.SIGNIFICANT * errors).mean() > 0.9


def test_the_noise_of_a_black_reference_is_zero():
    black = np.zeros((8, 3))
    assert metrics.leak_noise(black, black) == 0
