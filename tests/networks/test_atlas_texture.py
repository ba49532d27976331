"""The trainable texture: the graph's own fetch, its gradient, its quantiser."""

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.graph import Builder, evaluate
from lightwell.networks.atlas_texture import STEPS, AtlasTexture

RNG = np.random.default_rng(4)
TABLE = RNG.random((6 * 5, 4)).astype(np.float32)
PLACES = RNG.uniform(-0.1, 1.1, (64, 2)).astype(np.float32)


def read(quantiser: str) -> np.ndarray:
    return np.array(AtlasTexture(6, 5, 4, quantiser)(mi.TensorXf(TABLE), mi.TensorXf(PLACES)))


def test_it_reads_as_the_graph_does():
    b = Builder(uv=2)
    graph = b.build(texel=b.texture("uv", TABLE.reshape(6, 5, 4)))
    assert np.abs(read("none") - evaluate(graph, {"uv": PLACES})["texel"]).max() < 1e-6


def test_rounding_is_to_the_nearest_byte_and_truncation_would_be_seen():
    rounded = AtlasTexture(6, 5, 4, "round")
    stored = np.array(rounded._stored(mi.Float(TABLE.ravel())))
    assert np.abs(stored - TABLE.ravel()).max() <= 0.5 / STEPS + 1e-6
    # Truncation shifts every value by half a step on average; the mean of many shows it.
    many = RNG.random(40000).astype(np.float32)
    error = np.array(rounded._stored(mi.Float(many))) - many
    truncated = np.floor(many * STEPS) / STEPS - many
    bound = 4 * 0.29 / STEPS / np.sqrt(len(many))
    assert abs(error.mean()) < bound < abs(truncated.mean())


def test_noise_has_the_spread_of_rounding():
    texture = AtlasTexture(100, 100, 4, "noise")
    values = mi.Float(RNG.random(40000).astype(np.float32))
    noise = (np.array(texture._stored(values)) - np.array(values)) * STEPS
    assert abs(noise.mean()) < 0.01 and abs(noise.std() - np.sqrt(1 / 12)) < 0.01


@pytest.mark.parametrize("quantiser", ["none", "round", "frozen"])
def test_gradient(quantiser):
    texture = AtlasTexture(6, 5, 4, quantiser)
    table, weights = mi.TensorXf(TABLE), mi.TensorXf(RNG.normal(size=(64, 4)).astype(np.float32))
    dr.enable_grad(table)
    dr.backward(dr.sum(texture(table, mi.TensorXf(PLACES)) * weights, axis=None))
    found = np.array(dr.grad(table))
    if quantiser == "frozen":
        assert not found.any()
        return
    # The read is linear in the table: the gradient is the read of unit tables.
    for texel, channel in ((0, 0), (13, 2), (29, 3)):
        unit = np.zeros_like(TABLE)
        unit[texel, channel] = 1
        part = np.array(AtlasTexture(6, 5, 4)(mi.TensorXf(unit), mi.TensorXf(PLACES)))
        assert found[texel, channel] == pytest.approx(float((part * np.array(weights)).sum()), abs=1e-5)
