"""Pictures of the light of lamps: as few as their error allows, never negative, exact where there is one for each."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.fields.lightmap.lamp_rank import ENOUGH, cells_of, factorised, pictures_of

RNG = np.random.default_rng(7)


def mixed(lamps: int, pictures: int, cells: int = 400) -> np.ndarray:
    """[C, K, 3] light of lamps that is exactly that of so many pictures."""
    B = RNG.gamma(0.5, 1.0, (cells, pictures, 3))
    A = RNG.gamma(0.3, 1.0, (lamps, pictures, 3))
    A[:pictures] = np.eye(pictures)[..., None]
    light = np.einsum("krx,trx->tkx", A, B)
    return light / light.mean(axis=(0, 2))[:, None]


@pytest.mark.parametrize(("lamps", "pictures"), [(4, 1), (8, 2), (12, 4), (64, 3)])
def test_as_many_pictures_as_the_light_needs(lamps, pictures):
    light = mixed(lamps, pictures)
    found = factorised(light, np.ones(len(light)))
    assert found.rank == pictures and max(found.errors) <= ENOUGH and found.weights.min() >= 0
    again = np.einsum("krx,trx->tkx", found.weights, pictures_of(light, found.weights))
    assert np.abs(again - light).mean() < 0.03 * light.mean()


def test_lamps_of_different_places_have_a_picture_each_and_are_exact():
    light = np.zeros((90, 3, 3))
    for k in range(3):
        light[30 * k : 30 * k + 30, k] = RNG.random((30, 3)) + 0.1
    found = factorised(light, np.ones(90))
    assert found.rank == 3 and found.errors == (0.0, 0.0, 0.0)
    assert np.array_equal(pictures_of(light, found.weights), light.astype(np.float32))


def test_the_number_of_pictures_is_bounded_and_its_error_is_known():
    light = RNG.gamma(0.2, 1.0, (300, 9, 3))
    found = factorised(light, np.ones(300), most=4)
    assert found.rank == 4 and max(found.errors) > ENOUGH
    again = np.einsum("krx,trx->tkx", found.weights, pictures_of(light, found.weights))
    assert again.min() >= 0


def test_cells_are_means_of_their_texels():
    index = np.flatnonzero(RNG.random(200 * 200) < 0.3)
    shares = np.ones((len(index), 2, 3)) * np.array([1.0, 3.0])[:, None]
    means, count = cells_of(index, 200, shares)
    assert count.sum() == len(index)
    np.testing.assert_allclose(means, np.broadcast_to([[[1.0], [3.0]]], means.shape))
