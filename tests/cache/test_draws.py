"""Random numbers of rendering paths."""

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.sobol_sampler import draws


def _points(pairs, count=256, pixel=5, seed=9):
    d = draws(mi.UInt32(pixel), dr.arange(mi.UInt32, count), mi.UInt32(seed))
    return [np.array(d.next_2d()).T for _ in range(pairs)]


def test_every_pair_of_dimensions_is_a_0_2_sequence():
    for points in _points(4):
        for a in range(9):
            cells = set(zip((points[:, 0] * 2**a).astype(int), (points[:, 1] * 2 ** (8 - a)).astype(int)))
            assert len(cells) == 256


def test_pairs_pixels_and_seeds_are_unlike():
    a, b = _points(2)
    assert abs(np.corrcoef(a[:, 0], b[:, 0])[0, 1]) < 0.2  # 3.2 standard deviations
    assert not np.allclose(a, _points(1, pixel=6)[0])
    assert not np.allclose(a, _points(1, seed=10)[0])


def test_single_numbers_fill_the_line():
    d = draws(mi.UInt32(1), dr.arange(mi.UInt32, 64), mi.UInt32(0))
    assert len(set((np.array(d.next_1d()) * 64).astype(int))) == 64
