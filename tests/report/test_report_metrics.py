"""The metrics against closed forms, and their refusals."""

import numpy as np
import pytest

from lightwell.core.color import display, srgb
from lightwell.report import metrics, picture_metrics


@pytest.fixture
def picture():
    return np.random.default_rng(1).uniform(0.1, 0.5, (32, 48, 3))


def test_relative_error_of_a_constant_offset():
    y = np.full((7, 3), 0.24)
    spread = metrics.relative_error(y + 0.05, y)
    np.testing.assert_allclose([spread.mean, spread.median, spread.p95], 0.05 / 0.25)


def test_weighted_spread_is_that_of_repeated_points():
    rng = np.random.default_rng(2)
    f, y, times = rng.random((50, 3)), rng.random((50, 3)), rng.integers(1, 5, 50)
    repeated = metrics.relative_error(np.repeat(f, times, 0), np.repeat(y, times, 0))
    weighted = metrics.relative_error(f, y, times)
    np.testing.assert_allclose(list(vars(weighted).values()), list(vars(repeated).values()))


def test_p95_and_median_of_known_errors():
    y = np.full((100, 3), 0.99)
    f = y + np.arange(1, 101)[:, None] / 100
    spread = metrics.relative_error(f, y)
    np.testing.assert_allclose([spread.mean, spread.median, spread.p95], [0.505, 0.5, 0.95])


def test_noise_floor_is_the_error_of_a_perfect_prediction():
    # Both estimate the mean of the same half-normal: over 1e5 points they agree to 1 % (standard error 0.25 %).
    rng = np.random.default_rng(3)
    truth = np.full((100_000, 3), 1.0)
    a, b = (truth + 0.05 * rng.standard_normal(truth.shape) for _ in range(2))
    floor, error = metrics.noise_floor(a, b), metrics.relative_error(truth, 0.5 * (a + b))
    np.testing.assert_allclose(floor.mean, error.mean, rtol=0.01)
    np.testing.assert_allclose(floor.mean, 0.05 / np.sqrt(2) * np.sqrt(2 / np.pi) / 1.01, rtol=0.01)


def test_rel_mse_is_unbiased_by_noise():
    # True value: 0.1² / (1 + 1e-4). The noise left in the denominator adds 4 · 0.1 · 0.02² / 2, which is 0.8 % of it.
    rng = np.random.default_rng(4)
    truth = np.full((200_000, 3), 1.0)
    a, b = (truth + 0.02 * rng.standard_normal(truth.shape) for _ in range(2))
    np.testing.assert_allclose(metrics.rel_mse(truth + 0.1, a, b), 0.01, rtol=0.015)
    np.testing.assert_allclose(metrics.rel_mse(truth, a, b), 0, atol=1e-5)
    naive = np.mean((truth - a) ** 2)
    assert naive > 20 * 1e-5  # what the test above would miss if the halves were not independent


def test_energy_ratio_and_unit():
    y = np.array([[1.0, 1, 1], [3, 3, 3]])
    assert metrics.energy_ratio(0.9 * y, y) == pytest.approx(0.9)
    assert metrics.energy_ratio(np.add(y, [[1.0], [0.0]]), y, np.array([1, 3])) == pytest.approx(11 / 10)
    assert metrics.unit(y) == pytest.approx(8)


def test_per_object_rows():
    shape = np.array([0, 2, 2])
    y = np.full((3, 3), 0.99)
    rows = metrics.per_object(np.add(y, [[0.0], [0.1], [0.3]]), y, y, shape, ["floor", "unseen", "wall"])
    assert [row["name"] for row in rows] == ["floor", "wall"] and rows[1]["points"] == 2
    assert rows[1]["relative_error"] == pytest.approx(0.2) and rows[0]["energy_ratio"] == pytest.approx(1)
    dark = metrics.per_object(y, 0 * y, 0 * y, shape, ["a", "b", "c"])
    assert dark[0]["energy_ratio"] is None


def test_display_curve():
    assert display(np.array([0.0, -1.0])).tolist() == [0, 0]
    assert display(np.array([1.0]))[0] == pytest.approx(0.7353569830524495)  # sRGB of one half
    assert srgb(np.array([0.0031308]))[0] == pytest.approx(0.0404499, abs=1e-6)


def test_psnr_of_a_known_difference(picture):
    white = np.full((16, 16, 3), 1e9)
    assert picture_metrics.psnr_db(0 * white, white) == pytest.approx(0, abs=1e-3)
    assert picture_metrics.psnr_db(picture, picture) == picture_metrics.MAX_PSNR_DB


def test_ssim_and_flip_of_equal_and_different_pictures(picture):
    assert picture_metrics.ssim(picture, picture) == pytest.approx(1)
    assert picture_metrics.flip(picture, picture) == pytest.approx(0, abs=1e-6)
    other = picture[::-1]
    assert picture_metrics.ssim(other, picture) < 0.5 and picture_metrics.flip(other, picture) > 0.02
    # Black against white is FLIP's largest difference.
    assert picture_metrics.flip(np.zeros((16, 16, 3)), np.full((16, 16, 3), 1e9)) > 0.95


def test_the_worst_tile_is_where_the_error_is_and_not_where_the_noise_is():
    rng = np.random.default_rng(5)
    y = np.ones((40, 64, 3))
    a, b = (y.copy() for _ in range(2))
    for half in (a, b):
        half[:16, :16] += 0.5 * rng.standard_normal((16, 16, 3))
    f = y.copy()
    f[16:32, 32:48] = 1.5
    tiles = list(picture_metrics.tile_errors(f, a, b))
    worst = max(tiles, key=lambda tile: tile.error)
    assert len(tiles) == 2 * 4 and (worst.row, worst.column) == (16, 32)
    assert worst.error == pytest.approx((display(np.array(1.5)) - display(np.array(1.0))) ** 2)


@pytest.mark.parametrize("score", ["relative_error", "noise_floor", "energy_ratio", "psnr_db", "ssim", "flip"])
def test_nan_is_refused(score, picture):
    broken = picture.copy()
    broken[0, 0, 0] = np.nan
    module = metrics if hasattr(metrics, score) else picture_metrics
    with pytest.raises(ValueError, match=r"contains 1 NaN or infinite values of 4608; nothing is scored"):
        getattr(module, score)(broken, picture)


@pytest.mark.parametrize("off", [0.15, 0.3])
def test_an_error_without_noise_is_that_of_the_prediction(off):
    random = np.random.default_rng(3)
    truth = np.exp(random.normal(1, 1, size=(8192, 1))) * [1.0, 0.7, 0.4]
    a, b = (truth * random.gamma(4.0, 0.25, size=truth.shape) for _ in range(2))
    found = metrics.error_without_noise(truth * (1 + off), a, b)
    # Half of the reference has 50 % of noise: 0.25 / sqrt(8192) = 0.003 in the square. The raw error is above 20 %.
    assert abs(found**2 - off**2) < 0.012
    assert metrics.relative_error(truth * (1 + off), 0.5 * (a + b)).mean > 0.2


def test_an_error_that_is_smaller_than_the_noise_of_few_paths_is_none():
    random, truth = np.random.default_rng(4), np.ones((256, 3))
    a, b = (truth * random.gamma(0.1, 10.0, size=truth.shape) for _ in range(2))
    assert metrics.error_without_noise(1.1 * truth, a, b) is None


def test_light_in_the_dark_is_an_error_without_noise_too():
    dark, glow = np.zeros((256, 3)), np.full((256, 3), 0.02)
    assert metrics.error_without_noise(glow, dark, dark) == pytest.approx(2.0)


def test_nan_is_refused_by_rel_mse(picture):
    with pytest.raises(ValueError, match="half_b contains"):
        metrics.rel_mse(picture, picture, np.full_like(picture, np.inf))


def test_nonsense_is_refused(picture):
    with pytest.raises(ValueError, match="shapes differ"):
        metrics.relative_error(picture, picture[1:])
    assert metrics.energy_ratio(picture, 0 * picture) is None
    with pytest.raises(ValueError, match="at least one point"):
        metrics.relative_error(np.zeros((0, 3)), np.zeros((0, 3)))
    with pytest.raises(ValueError, match="weights must be 4 finite"):
        metrics.relative_error(np.ones((4, 3)), np.ones((4, 3)), np.zeros(4))
    with pytest.raises(ValueError, match="at least 11x11 pixels"):
        picture_metrics.ssim(picture[:5], picture[:5])


def test_the_ceiling_of_psnr_is_what_a_perfect_prediction_scores():
    """A noisy reference against its noise-free expectation: within a tenth of a decibel over 30,000 values."""
    rng = np.random.default_rng(0)
    truth = np.full((100, 100, 3), 0.5)
    a, b = (truth + 0.02 * rng.standard_normal(truth.shape) for _ in range(2))
    perfect = picture_metrics.psnr_db(truth, 0.5 * (a + b))
    assert picture_metrics.psnr_ceiling_db(a, b) == pytest.approx(perfect, abs=0.1)
    assert picture_metrics.psnr_ceiling_db(a, a) == picture_metrics.MAX_PSNR_DB
