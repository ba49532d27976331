"""The head in one kernel against layers of products, and features in columns of a table against the grids alone."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.networks.factored import FactoredNetwork
from lightwell.networks.hashgrid import HashGrid
from lightwell.networks.head import FUSED, fused_head
from lightwell.networks.mlp import ACTIVATIONS, DERIVATIVES, apply_layers

pytestmark = pytest.mark.gpu
needs_llvm = pytest.mark.skipif(not FUSED, reason="cooperative vectors need OptiX with CUDA")
ROWS, UNITS, INPUTS = 200, 12, 7
MIRROR = HashGrid(levels=2, base=3, growth=2, entries_log2=8)
NETWORK = FactoredNetwork(HashGrid(levels=3, base=4, growth=2, entries_log2=8), 5, 4, (8,), (UNITS, 6), MIRROR)


def drawn(rng: np.random.Generator, *shape: int):
    return mi.TensorXf(rng.standard_normal(shape).astype(np.float32))


def by_products(activations, z, pixel, weights):
    """The same by whole matrices."""
    x = ACTIVATIONS[activations[0]](z + dr.matmul(pixel, weights[0]))
    named = {f"{name}{k // 2}": w for k, (name, w) in enumerate(zip("wb" * len(weights), weights[1:]))}
    return apply_layers(named, x, activations[1:])


def gradients(head, activations, z, pixel, weights):
    for value in (z, *weights):
        dr.enable_grad(value)
        dr.clear_grad(value)
    out = head(activations, z, pixel, weights)
    dr.backward(dr.sum(out * dr.sin(out + 1), axis=None))
    return [np.array(dr.grad(value)) for value in (z, *weights)], np.array(dr.detach(out))


@pytest.mark.parametrize("name", sorted(ACTIVATIONS))
def test_derivatives_are_those_of_the_activations(name):
    x = mi.Float(np.float32([-70, -3, -0.7, 0.2, 1, 4, 70] if name == "exp" else [-9, -3, -0.7, 0.2, 1, 4]))
    dr.enable_grad(x)
    y = ACTIVATIONS[name](x)
    dr.backward(y)
    found = dr.full(mi.Float, 1, 1) * DERIVATIVES[name](dr.detach(x), dr.detach(y))
    np.testing.assert_allclose(
        np.broadcast_to(found.numpy(), 7 if name == "exp" else 6), dr.grad(x).numpy(), 2e-6, 2e-7
    )


@needs_llvm
@pytest.mark.parametrize(
    "activations, widths",
    [
        (("silu", "silu", "exp"), (6, 3)),
        (("silu", "exp"), (3,)),
        (("relu", "tanh", "softplus", "identity"), (9, 4, 3)),
        (("sine", "sigmoid"), (2,)),
    ],
)
def test_head_is_that_of_products(activations, widths):
    rng = np.random.default_rng(1)
    z, pixel = drawn(rng, ROWS, UNITS), drawn(rng, ROWS, INPUTS)
    sizes = (UNITS, *widths)
    weights = [drawn(rng, INPUTS, UNITS)]
    for a, b in pairwise(sizes):
        weights += [drawn(rng, a, b) * 0.4, drawn(rng, 1, b)]
    found, out = gradients(fused_head, activations, z, pixel, weights)
    expected, truth = gradients(by_products, activations, z, pixel, weights)
    np.testing.assert_allclose(out, truth, rtol=2e-5, atol=1e-5)
    for a, b in zip(found, expected):
        assert a.shape == b.shape
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-4 * np.abs(b).max())


@needs_llvm
def test_head_without_gradients_is_the_same():
    rng = np.random.default_rng(2)
    z, pixel = drawn(rng, ROWS, UNITS), drawn(rng, ROWS, INPUTS)
    weights = [drawn(rng, INPUTS, UNITS), drawn(rng, UNITS, 3), drawn(rng, 1, 3)]
    with dr.suspend_grad():
        plain = np.array(fused_head(("silu", "exp"), z, pixel, weights))
    assert np.array_equal(plain, gradients(fused_head, ("silu", "exp"), z, pixel, weights)[1])


@needs_llvm
def test_gradients_of_the_head_are_the_same_each_time():
    rng = np.random.default_rng(3)
    z, pixel = drawn(rng, 5000, UNITS), drawn(rng, 5000, INPUTS)
    weights = [drawn(rng, INPUTS, UNITS), drawn(rng, UNITS, 3) * 0.3, drawn(rng, 1, 3)]
    first, again = (gradients(fused_head, ("silu", "exp"), z, pixel, weights)[0] for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(first, again))


@pytest.mark.parametrize("first, width", [(0, 9), (4, 13), (3, 12)])
def test_columns_of_a_table_hold_the_grid_and_its_gradient(first, width):
    grid, rng = HashGrid(levels=2, base=3, growth=2, entries_log2=7), np.random.default_rng(4)
    table, points = mi.TensorXf(grid.initial(rng, 1.0)), mi.TensorXf(rng.random((50, 3)).astype(np.float32))
    factor = mi.Float(rng.random(50).astype(np.float32))
    out = dr.zeros(mi.Float, 50 * width)
    grid.write(out, width, first, table, points, factor)
    found, columns = np.array(out).reshape(50, width), slice(first, first + grid.width)
    expected = np.array(grid.evaluate(table, points)) * np.array(factor)[:, None]
    np.testing.assert_allclose(found[:, columns], expected, rtol=1e-6)
    assert not np.delete(found, np.arange(width)[columns], axis=1).any()
    slope = rng.standard_normal((50, width)).astype(np.float32)
    parts = mi.TensorXf(np.ascontiguousarray(slope[:, columns] * np.array(factor)[:, None]))
    a = np.array(grid.gradient(points, mi.TensorXf(slope), first, factor))
    np.testing.assert_allclose(a, np.array(grid.gradient(points, parts)), atol=1e-6)


@pytest.mark.parametrize("mirror", [MIRROR, None])
@pytest.mark.parametrize("frame", [4, 0])
def test_factored_network_is_its_formula(mirror, frame):
    network, rng = replace(NETWORK, mirror=mirror, frame=frame), np.random.default_rng(5)
    lights, rows = (3, 30) if frame else (1, 90)
    values = {k: v + 0.1 * rng.standard_normal(v.shape) for k, v in network.initial(0).items()}
    values = {k: v.astype(np.float32) for k, v in values.items()}
    points = rng.random((lights * rows, 7 if mirror else 3)).astype(np.float32)
    pixel = rng.standard_normal((lights * rows, 5)).astype(np.float32)
    light = rng.standard_normal((lights, frame or 1)).astype(np.float32)
    found = network.evaluate(values, (points, pixel, light))

    silu = lambda x: x / (1 + np.exp(-x))  # noqa: E731
    u = np.array(network.grid.evaluate(mi.TensorXf(values["grid"]), mi.TensorXf(points[:, :3].copy())))
    if mirror:
        seen = np.array(mirror.evaluate(mi.TensorXf(values["mirror"]), mi.TensorXf(points[:, 3:6].copy())))
        u = np.concatenate([u, seen * points[:, 6:]], axis=1)
    layer = values["emit_b"]
    if frame:
        layer = silu(light @ values["light_w0"] + values["light_b0"]) @ values["emit_w"] + layer
    W, b = layer[:, :-UNITS].reshape(lights, -1, UNITS), layer[:, -UNITS:]
    z = (u.reshape(lights, rows, -1) @ W + b[:, None]).reshape(-1, UNITS) + pixel @ values["pixel_w"]
    x = silu(silu(z) @ values["w0"] + values["b0"])
    np.testing.assert_allclose(found, np.exp(x @ values["w1"] + values["b1"]), rtol=2e-4)
