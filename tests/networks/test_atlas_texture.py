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
    stored = np.array(rounded.stored(mi.Float(TABLE.ravel())))
    assert np.abs(stored - TABLE.ravel()).max() <= 0.5 / STEPS + 1e-6
    # Truncation shifts every value by half a step on average; the mean of many shows it.
    many = RNG.random(40000).astype(np.float32)
    error = np.array(rounded.stored(mi.Float(many))) - many
    truncated = np.floor(many * STEPS) / STEPS - many
    bound = 4 * 0.29 / STEPS / np.sqrt(len(many))
    assert abs(error.mean()) < bound < abs(truncated.mean())


def test_noise_has_the_spread_of_rounding():
    texture = AtlasTexture(100, 100, 4, "noise")
    values = mi.Float(RNG.random(40000).astype(np.float32))
    noise = (np.array(texture.stored(values)) - np.array(values)) * STEPS
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


FAR = RNG.random((8 * 12, 4)).astype(np.float32)


@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_level_of_the_mip_chain_is_read_as_the_graph_reads_means(level):
    edge = 1 << level
    means = FAR.reshape(8 // edge, edge, 12 // edge, edge, 4).mean(axis=(1, 3))
    b = Builder(uv=2)
    graph = b.build(texel=b.texture("uv", means))
    found = np.array(AtlasTexture(8, 12, 4, "none", level)(mi.TensorXf(FAR), mi.TensorXf(PLACES)))
    assert np.abs(found - evaluate(graph, {"uv": PLACES})["texel"]).max() < 1e-6


def test_the_gradient_of_a_level_is_spread_over_its_means():
    texture = AtlasTexture(8, 12, 4, "none", 1)
    table, weights = mi.TensorXf(FAR), mi.TensorXf(RNG.normal(size=(64, 4)).astype(np.float32))
    dr.enable_grad(table)
    dr.backward(dr.sum(texture(table, mi.TensorXf(PLACES)) * weights, axis=None))
    found = np.array(dr.grad(table))
    for texel, channel in ((0, 0), (29, 2), (95, 3)):
        unit = np.zeros_like(FAR)
        unit[texel, channel] = 1
        part = np.array(AtlasTexture(8, 12, 4, "none", 1)(mi.TensorXf(unit), mi.TensorXf(PLACES)))
        assert found[texel, channel] == pytest.approx(float((part * np.array(weights)).sum()), abs=1e-5)


def test_a_texture_without_such_a_level_is_refused():
    with pytest.raises(ValueError, match="have no mip level 2"):
        AtlasTexture(6, 8, 4, "none", 2)
