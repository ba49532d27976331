"""Sobol sequences: those of SciPy, number by number."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import qmc

from lightwell.core.sobol import BITS, Sobol


@pytest.mark.parametrize("dimensions", range(1, 8))
def test_they_are_those_of_scipy(dimensions):
    rngs = (np.random.default_rng([3, dimensions]) for _ in range(2))
    own, other = Sobol(dimensions, next(rngs)), qmc.Sobol(dimensions, scramble=True, rng=next(rngs))
    for count in (64, 64, 1, 300):
        np.testing.assert_array_equal(own.random(count), other.random(count))


def test_the_stream_of_random_numbers_stays_and_a_seed_serves():
    rng = np.random.default_rng(5)
    first = Sobol(3, rng).random(8)
    assert rng.random() == np.random.default_rng(5).random() and not np.array_equal(first, Sobol(3, rng).random(8))
    np.testing.assert_array_equal(Sobol(3, 6).random(16), Sobol(3, 6).random(16))
    np.testing.assert_array_equal(Sobol(3, 6).random(16), qmc.Sobol(3, scramble=True, seed=6).random(16))


@pytest.mark.parametrize("dimensions", [0, 8])
def test_dimensions_without_direction_numbers_are_refused(dimensions):
    with pytest.raises(ValueError, match=f"1 to 7 dimensions, found {dimensions}"):
        Sobol(dimensions, 0)


def test_a_sequence_has_an_end():
    with pytest.raises(ValueError, match=f"has {1 << BITS} points"):
        Sobol(1, np.random.default_rng(0)).random((1 << BITS) + 1)


def test_the_package_does_without_scipys_statistics():
    """Their import takes longer than all others of a bake."""
    files = (Path(__file__).parents[2] / "lightwell").rglob("*.py")
    assert [path.name for path in files if re.search(r"(import|from) scipy\.stats", path.read_text())] == []
