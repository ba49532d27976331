"""The errors and gains of the equal-time table, against closed forms."""

import numpy as np
import pytest
from radiance_cache_table import CHOICE, HALVES, HELD_OUT, SQUARED, WORST, errors, summary, table_rows
from radiance_cache_truth import EPSILON, Truth
from zoo_scenes import CREDITS

SHAPE = (40, 50, 3)


def truth(noise: float = 0.0, level: float = 7.0) -> tuple[np.ndarray, Truth]:
    """A picture, and its two halves with independent noise."""
    rng = np.random.default_rng(1)
    right = level * (0.2 + rng.random(SHAPE))
    a, b = (right * (1 + noise * rng.standard_normal(SHAPE)) for _ in range(2))
    return right, Truth(a, b, 64)


def test_errors_of_a_brighter_picture():
    right, known = truth()
    found = errors(known, 1.1 * right)
    r = right / right.mean()
    assert found["relMSE"] == pytest.approx(float(np.mean(0.01 * r**2 / (r**2 + EPSILON))), rel=1e-6)
    assert found["energy"] == pytest.approx(0.1, abs=1e-6)
    assert found["sMAPE"] == pytest.approx(float(np.mean(0.1 * r / (2.1 * r + EPSILON))), rel=1e-6)
    assert 0 < found["trimmed"] <= found["relMSE"] and 0 < found["FLIP"] < 0.3
    assert errors(known, right) == pytest.approx(dict.fromkeys(found, 0.0), abs=1e-6)


def test_brightness_of_the_scene_does_not_matter():
    (right, known), (bright, other) = truth(), truth(level=7e3)
    assert errors(known, 1.2 * right) == pytest.approx(errors(other, 1.2 * bright), rel=1e-4)


def test_worst_pixels_are_trimmed_and_no_more():
    right, known = truth()
    count = int(WORST * right[..., 0].size)
    for pixels, trimmed in ((count, True), (count + 1, False)):
        picture = right.copy()
        picture.reshape(-1, 3)[:pixels] *= 100
        found = errors(known, picture)
        assert found["relMSE"] > 1 and (found["trimmed"] < 1e-6) == trimmed


def test_noise_of_the_reference_does_not_count():
    right, known = truth(0.1)
    # Standard error: 0.1^2 / sqrt(6000). Against the mean of the halves the error would be 0.1^2 / 2.
    assert abs(errors(known, right)["relMSE"]) < 5e-4


def run(error: float, wall: float, energy: float) -> dict:
    facts = {"wall": wall, "train": 0.1, "samples": 8, "guided": 0, "energy": energy}
    return {"relMSE": error, "trimmed": error, "sMAPE": error, "FLIP": error} | facts


def test_gains_are_error_times_time_and_z_is_that_of_the_means():
    runs = {"path": [run(0.4, 2.0, e) for e in (-0.01, 0.0, 0.01)], "cache": [run(0.1, 1.0, 0.0)] * 3,
            "guided": [run(0.4, 4.0, e) for e in (0.02, 0.03, 0.04)]}  # fmt: skip
    found = summary(runs)
    assert found["gains"]["cache"] == pytest.approx({"relMSE": 8, "trimmed": 8, "sMAPE": 4, "FLIP": 4})
    assert [found["gains"]["guided"][e] for e in SQUARED] == pytest.approx([0.5, 0.5])
    assert found["z"] == pytest.approx(0.03 / np.sqrt(2 * 0.01**2 / 3))


def test_halves_are_apart_and_figures_of_merit_need_all_scenes():
    assert len(HALVES) == 16 == len(CHOICE) + len(HELD_OUT) and set(HALVES) <= set(CREDITS)
    one = {"half": "choice", "repeats": 3} | summary({side: [run(0.4, 2.0, 0.0), run(0.4, 2.0, 0.1)]
                                                      for side in ("path", "cache", "guided")})  # fmt: skip
    plan = {"size": 64}
    partial = table_rows({name: one for name in CHOICE}, plan)
    known = {row.what: row for row in partial}
    assert known["table: relMSE of path over guided, least of the scenes choice"].holds
    assert known["table: relMSE of path over guided, least of the scenes held out"].measured is None
    assert known["table: largest z of the mean of guided against path"].measured is None
    assert not known["table: scenes"].holds
