"""Decay of a hash grid's levels, and the table as it is stored."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.networks.hashgrid import HashGrid

GRID = HashGrid(levels=3, base=2, entries_log2=8, decay=(0.0, 0.5, 2.0))


def test_decay_is_the_gradient_of_the_mean_square_of_each_level():
    table = np.random.default_rng(0).normal(size=(GRID.entries, 4)).astype(np.float32)
    found = np.array(GRID.decayed(mi.TensorXf(table), mi.TensorXf(np.zeros_like(table))))
    for level, weight in zip(GRID.layout, GRID.decay):
        rows = slice(level.offset, level.offset + level.entries)
        assert found[rows] == pytest.approx(2 * weight * table[rows] / table[rows].size, rel=1e-5)


def test_one_decay_for_each_level():
    with pytest.raises(ValueError, match="2 decays for 3 levels"):
        HashGrid(levels=3, decay=(0.0, 1.0))


def test_an_even_table_has_one_step_for_all_levels():
    scale = np.repeat([1.0, 1e-2, 1e-4], [level.entries for level in GRID.layout])[:, None]
    table = (scale * np.random.default_rng(1).normal(size=(GRID.entries, 4))).astype(np.float32)
    even, steps = GRID.even(table)
    assert np.abs(even).max() == 1 and steps.shape == (12,)
    for k, level in enumerate(GRID.layout):
        rows = slice(level.offset, level.offset + level.entries)
        assert even[rows] * steps[4 * k : 4 * k + 4] == pytest.approx(table[rows], rel=1e-6)
