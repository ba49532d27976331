"""Weights of training samples."""

import numpy as np

from lightwell.fields.surface.sample_weights import by_object


def test_every_object_counts_as_often_as_it_was_sampled():
    rng = np.random.default_rng(0)
    shape = np.repeat([0, 2, 3], [1000, 50, 10])
    weight = rng.random(len(shape)) * np.where(shape == 0, 1.0, 0.05)
    weight[shape == 3] = 0
    result = by_object(shape, weight)
    assert result.dtype == np.float32
    for s in (0, 2):
        assert np.isclose(result[shape == s].mean(), 1, atol=1e-5)
        ratio = result[shape == s] / weight[shape == s]
        assert np.allclose(ratio, ratio[0], rtol=1e-5)
    assert (result[shape == 3] == 0).all()
