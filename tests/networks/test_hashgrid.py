"""The trainable hash grid against the shading graph's op, and its gradient."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.graph import Builder, evaluate
from lightwell.networks.hashgrid import HashGrid

pytestmark = pytest.mark.gpu

GRIDS = [HashGrid(), HashGrid(levels=2, base=3, growth=5, entries_log2=7, channels=8)]


@pytest.fixture
def points() -> np.ndarray:
    # Some lie on the faces of the cube and beyond.
    return np.random.default_rng(1).uniform(-0.1, 1.1, (500, 3)).astype(np.float32)


def loss(grid: HashGrid, table, points, target):
    return dr.mean(dr.square(grid(table, points) - target), axis=None)


@pytest.mark.parametrize("grid", GRIDS)
def test_is_the_graph_s_hash_grid(grid, points):
    table = grid.initial(np.random.default_rng(0), 1.0)
    b = Builder(p=3)
    node = b.hashgrid(
        "p", table, levels=grid.levels, base=grid.base, growth=grid.growth, entries_log2=grid.entries_log2
    )
    expected = evaluate(b.build(value=node), {"p": points})["value"]
    found = np.array(grid(mi.TensorXf(table), mi.TensorXf(points)))
    np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize("grid", GRIDS)
def test_gradient_is_that_of_the_interpolation(grid, points):
    rng = np.random.default_rng(2)
    table, target = grid.initial(rng, 1.0), mi.TensorXf(rng.random((len(points), grid.width)).astype(np.float32))
    tensor, p = mi.TensorXf(table), mi.TensorXf(points)
    dr.enable_grad(tensor)
    dr.backward(loss(grid, tensor, p, target))
    # The loss is quadratic in the table: a central difference along a direction is exact but for rounding.
    direction = rng.standard_normal(table.shape).astype(np.float32)
    high, low = (float(loss(grid, mi.TensorXf(table + s * direction), p, target).array[0]) for s in (1.0, -1.0))
    assert (np.array(dr.grad(tensor), np.float64) * direction).sum() == pytest.approx((high - low) / 2, rel=1e-3)


def test_gradient_does_not_depend_on_the_order_of_the_points(points):
    grid, rng = GRIDS[0], np.random.default_rng(3)
    features, order = rng.standard_normal((len(points), grid.width)).astype(np.float32), rng.permutation(len(points))
    a = grid.gradient(mi.TensorXf(points), mi.TensorXf(features))
    b = grid.gradient(mi.TensorXf(points[order]), mi.TensorXf(features[order]))
    assert np.array_equal(np.array(a), np.array(b))


def test_channels_come_in_packets():
    with pytest.raises(ValueError, match="hash grid: 3 channels, expected a multiple of 4"):
        HashGrid(channels=3)
